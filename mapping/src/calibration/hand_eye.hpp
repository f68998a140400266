#pragma once

#include <stillmap/maps/small_matrices.hpp>

#include <Eigen/Geometry>

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// The same motion as two sensors on one body felt it: T_first_last of each.
struct MotionPair {
  Eigen::Isometry3d T_reference = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d T_lidar = Eigen::Isometry3d::Identity();
};

/// How a sensor stands in the frame of another one, and how well that is known.
struct MountEstimate {
  Eigen::Isometry3d T_reference_lidar = Eigen::Isometry3d::Identity();
  /// Rows x y z [m], turns about x y z [rad]; all along the axes of the reference: the estimate is
  /// off by a shift and a turn applied on the left of its translation and its rotation.
  maps::Matrix6d covariance = maps::Matrix6d::Identity();
};

/// What is known of a mount before anything is measured: nothing. A parameter that stays near it
/// was not observed [m, rad].
inline constexpr double kUnknownMountM = 5.0;
inline constexpr double kUnknownMountRad = 1.0;
[[nodiscard]] maps::Matrix6d unknown_mount_covariance();

/// The mount that makes all motions of one sensor those of the other: least squares of
/// log(T_lidar^-1 X^-1 T_reference X), rotation parts first for a start. A robust kernel leaves out
/// motions that do not fit.
///
/// What the motions do not tell keeps the deviation of `kUnknownMountM` and `kUnknownMountRad`: a
/// vehicle that only turns about one axis does not tell the shift along it, one that only drives
/// straight tells no shift at all and no turn about its way.
/// The covariance takes the motions for independent.
/// @return nothing for fewer than 6 motions, or where neither turns nor ways tell the rotation.
/// @see Tsai, Lenz, "A New Technique for Fully Autonomous and Efficient 3D Robotics Hand/Eye
/// Calibration", IEEE T-RA 1989 (AX = XB, rotation first); we add the directions of straight ways,
/// since vehicles turn about one axis only, and refine all six parameters at once.
[[nodiscard]] std::optional<MountEstimate> fit_hand_eye(std::span<const MotionPair> motions);

/// `fit` of all and of all but each of some blocks in turn; the spread of these is the covariance
/// (delete-a-group jackknife), no less than what the fit itself says. If all but one of the blocks
/// tell no mount, nothing counts as observed.
/// @param blocks  number of the block of each motion, from 0 on.
/// @see Busing, Meijer, van der Leeden, "Delete-m Jackknife for Unequal m", Statistics and
/// Computing 1999.
[[nodiscard]] std::optional<MountEstimate> fit_hand_eye_in_blocks(
    std::span<const MotionPair> motions, std::span<const std::size_t> blocks);

/// By which one mount differs from another, in the order of `MountEstimate::covariance`.
[[nodiscard]] maps::Vector6d difference_of_mounts(const Eigen::Isometry3d& T_reference_lidar,
                                                  const Eigen::Isometry3d& from);
/// The mount changed by such a difference.
[[nodiscard]] Eigen::Isometry3d changed_mount(const Eigen::Isometry3d& T_reference_lidar,
                                              const maps::Vector6d& by);

/// Covariance of a mean by what the values without each of the blocks say.
/// @param without  differences from the value of all, one a block.
[[nodiscard]] maps::Matrix6d jackknife_covariance(std::span<const maps::Vector6d> without);

}  // namespace stillmap::mapping
