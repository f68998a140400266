#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <optional>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// What a scan saw around the sensor, to be looked for in the next one. A scan from nearby sees
/// most of it again; one of a covered sensor, or of dust, next to nothing, wherever it is laid.
class SeenAgain {
 public:
  /// @param points_lidar  deskewed [m], here and in `share`.
  void remember(std::span<const Eigen::Vector3f> points_lidar,
                const Eigen::Isometry3d& T_odom_lidar);
  /// Share of the remembered points within 30 m of the sensor that have a point of this scan within
  /// 0.5 to 1 m, in [0, 1]; nothing where there are too few to tell.
  [[nodiscard]] std::optional<double> share(std::span<const Eigen::Vector3f> points_lidar,
                                            const Eigen::Isometry3d& T_odom_lidar) const;

 private:
  std::vector<Eigen::Vector3d> points_odom_;
};

}  // namespace stillmap::mapping
