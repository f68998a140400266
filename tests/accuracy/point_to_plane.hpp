#pragma once

#include <stillmap/maps/scan.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <memory>
#include <optional>
#include <vector>

namespace stillmap::test {

/// Edge of the voxels that thin map and scan [m].
inline constexpr double kReferenceLeafM = 0.1;

/// PCL's point-to-plane ICP (`IterativeClosestPointWithNormals`) on points of which it keeps one in
/// 0.1 m: slow and as exact as the points allow. Nothing of our own aligners is in it.
///
/// Pairs up to 1 m apart pull the scan near, then those up to 0.3 m until a step moves it by less
/// than 0.1 mm.
class PointToPlaneReference {
 public:
  /// @param points_map  [m], at least 100.  @throws std::invalid_argument with fewer.
  explicit PointToPlaneReference(const std::vector<Eigen::Vector3d>& points_map);
  ~PointToPlaneReference();

  /// @param scan_lidar  deskewed, finite.  @param T_map_lidar_start  within some decimetres.
  /// @return T_map_lidar; nothing when it has not come to rest within 100 steps.
  [[nodiscard]] std::optional<Eigen::Isometry3d> align(
      const std::vector<Eigen::Vector3f>& scan_lidar,
      const Eigen::Isometry3d& T_map_lidar_start) const;

 private:
  struct Target;
  std::unique_ptr<const Target> target_;
};

}  // namespace stillmap::test
