#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// One scan whose pose is known in two frames: that of the drives' own poses, and that of a map in
/// which it was localized.
struct FrameSight {
  Eigen::Isometry3d T_own_lidar = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d T_map_lidar = Eigen::Isometry3d::Identity();
  /// Of `T_map_lidar`: tx ty tz [m], rx ry rz [rad], perturbation on the right, in the lidar frame.
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Identity();
  /// Over all drives.
  std::size_t scan = 0;
};

/// How far a sight may be from a motion of the frames and still agree with it, at the sensor.
struct FrameTolerance {
  double translation_m = 0.0;
  double rotation_rad = 0.0;
};

/// The motion of one sight that most others agree with.
/// @return nothing where fewer than `least`, or not more than half of all, agree with any.
[[nodiscard]] std::optional<Eigen::Isometry3d> most_agreed(std::span<const FrameSight> sights,
                                                           const FrameTolerance& tolerance,
                                                           std::size_t least);

/// One motion between two frames.
struct FrameFit {
  Eigen::Isometry3d T_map_own = Eigen::Isometry3d::Identity();
  /// A flag for each sight.
  std::vector<std::uint8_t> agrees;
  std::size_t agreeing = 0;
  /// Root mean square over the sights that agree of what they differ by, at the sensor.
  double residual_m = 0.0;
  double residual_rad = 0.0;
};

/// The motion that all sights together say: least squares of log(T_map_lidar^-1 T_map_own
/// T_own_lidar), weighted by the sights' covariances and 1 cm, 0.5 mrad for the poses' own errors,
/// with a Geman-McClure kernel that narrows from 100 to 3 deviations.
///
/// Same input, same bits.
/// @param start      within 100 deviations of the answer, see `most_agreed`.
/// @param tolerance  for `agrees`.
/// @see Yang, Antonante, Tzoumas, Carlone, "Graduated Non-Convexity for Robust Spatial Perception",
/// RA-L 2020, eq. (10): weights of Geman-McClure; we halve the kernel instead of its square's 1.4.
[[nodiscard]] FrameFit fit_frames(std::span<const FrameSight> sights,
                                  const Eigen::Isometry3d& start, const FrameTolerance& tolerance);

}  // namespace stillmap::mapping
