#pragma once

#include <stillmap/maps/scan.hpp>

#include <Eigen/Core>

#include <cstdint>
#include <memory>
#include <optional>
#include <string_view>
#include <vector>

namespace stillmap::mapping {

/// The ground around one scan as a height field over x, y in the lidar frame.
class GroundSurface {
 public:
  struct Sample {
    double z = 0.0;
    /// Upward unit normal.
    Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
    /// 1 on ground that was seen, falling to 0 with the distance to it.
    double confidence = 0.0;
  };
  virtual ~GroundSurface() = default;
  /// @return nothing where no ground is known near enough.
  [[nodiscard]] virtual std::optional<Sample> at(double x, double y) const = 0;
};

struct GroundResult {
  /// N flags, 1 = ground.
  std::vector<std::uint8_t> is_ground;
  std::shared_ptr<const GroundSurface> surface;
};

/// Stage "ground": which points are ground, and where the ground is under the others.
class GroundSegmenter {
 public:
  virtual ~GroundSegmenter() = default;
  /// @param cloud  lidar frame, z roughly up; may be empty. Safe from several threads. Same input,
  /// same bits.
  [[nodiscard]] virtual GroundResult segment(const maps::PointCloud& cloud) const = 0;
  /// Adapts to the drive from one of its scans. Optional; to be called serially, before `segment`.
  virtual void learn(const maps::PointCloud& cloud) = 0;
};

struct GroundOptions {
  /// Height of the sensor over the ground [m], > 0; none = found in the scans.
  std::optional<double> sensor_height_m;
};

[[nodiscard]] std::unique_ptr<GroundSegmenter> make_ground_segmenter(
    const GroundOptions& options = {});

}  // namespace stillmap::mapping
