#pragma once

#include <stillmap/mapping/progress.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// A scan as cleaning sees it: deskewed, with its pose. "Local" is the map frame less the map's
/// origin, so that floats hold.
struct PosedScan {
  Eigen::Isometry3d T_local_lidar = Eigen::Isometry3d::Identity();
  /// N points in the lidar frame [m], all finite.
  std::vector<Eigen::Vector3f> positions;
  /// N flags, 1 = ground.
  std::vector<std::uint8_t> is_ground;
  /// N flags, 1 = inside a found object. Such a point is not in the map, but its ray still ended
  /// there.
  std::vector<std::uint8_t> in_object;
};

/// The scans that a map was made of, in their order. Safe from several threads.
class ScanSource {
 public:
  virtual ~ScanSource() = default;
  [[nodiscard]] virtual std::size_t size() const = 0;
  /// Without reading the scan.
  [[nodiscard]] virtual Eigen::Isometry3d T_local_lidar(std::size_t scan) const = 0;
  /// @throws maps::InputError, maps::StorageError.
  [[nodiscard]] virtual PosedScan read(std::size_t scan) const = 0;
};

/// The measured points of a map: means of voxels.
struct CleaningPoints {
  /// M points, local frame [m].
  std::vector<Eigen::Vector3f> positions;
  /// M flags, 1 = ground.
  std::vector<std::uint8_t> is_ground;
  /// M numbers: scans with at least one point in the voxel, >= 1.
  std::vector<std::uint32_t> scans;
  /// Edge of the voxels [m].
  double voxel_size_m = 0.1;
};

/// Stage "clean": which points of a map belong to something that moved.
class Cleaner {
 public:
  virtual ~Cleaner() = default;
  /// @return M flags, 1 = goes. Same input, same bits, for any number of threads.
  /// @throws Cancelled, and what the source throws.
  [[nodiscard]] virtual std::vector<std::uint8_t> moved(const CleaningPoints& points,
                                                        const ScanSource& scans,
                                                        const ProgressCallback& progress,
                                                        const CancelFlag& cancel) const = 0;
};

/// Makes the cleaner of this name; null if the name is not known.
using CleanerFactory = std::function<std::unique_ptr<Cleaner>(const std::string& name)>;

}  // namespace stillmap::mapping
