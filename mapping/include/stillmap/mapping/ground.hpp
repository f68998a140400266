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
  /// `at(x, y)->z`.
  [[nodiscard]] virtual std::optional<double> z_at(double x, double y) const {
    const std::optional<Sample> sample = at(x, y);
    return sample ? std::optional(sample->z) : std::nullopt;
  }
};

struct GroundResult {
  /// N flags, 1 = ground.
  std::vector<std::uint8_t> is_ground;
  std::shared_ptr<const GroundSurface> surface;
};

/// Stage "ground": which points are ground, and where the ground is under the others.
///
/// Patchwork++ (Lee, Lim, Myung, IROS 2022) proposes patches of ground; heights of 1 m cells grow
/// from them, each predicted from the ground around it; points near these heights are ground. The
/// paper's form is online: each scan changes the thresholds for the next one. A drive's scans are
/// segmented in parallel here and must give the same whatever the order, so what is learned over
/// scans (the sensor's height, and the elevation and flatness of ground in the nearest rings) is
/// learned beforehand, from a few of them, and then stays as it is.
class GroundSegmenter {
 public:
  virtual ~GroundSegmenter() = default;
  /// Works without having learned anything too.
  /// @param cloud  lidar frame, z up to within some 15 degrees; may be empty. Intensities are used
  /// where there are some.
  /// @note Safe from several threads, but not beside `learn`. Same input and same scans learned
  /// from, same bits.
  [[nodiscard]] virtual GroundResult segment(const maps::PointCloud& cloud) const = 0;
  /// Adapts to a drive by one of its scans. Some ten that are spread over it are enough; a scan
  /// without ground under the sensor changes nothing.
  /// @note Their order matters, and no `segment` may run beside it.
  virtual void learn(const maps::PointCloud& cloud) = 0;
};

struct GroundOptions {
  /// Height of the sensor over the ground [m], > 0; right to within 0.3 m, or no ground is found.
  /// None: found in each scan, and once three scans were learned from, within 0.5 m of their
  /// median.
  std::optional<double> sensor_height_m;
};

/// @throws std::invalid_argument for a height that is not > 0 and finite.
[[nodiscard]] std::unique_ptr<GroundSegmenter> make_ground_segmenter(
    const GroundOptions& options = {});

}  // namespace stillmap::mapping
