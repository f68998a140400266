#pragma once

#include "residual_rows.hpp"

#include <Eigen/Geometry>

namespace stillmap::localization {

/// What may be left in a scan.
enum class MotionLeft {
  kNone,      ///< deskewed by the map, which tells what that leaves
  kLittle,    ///< said to be deskewed
  kPossible,  ///< nothing says that it was deskewed
};

/// Covariance of a pose by errors that many points share, which no number of points averages out:
///
/// - **the map's own.** Where its surfaces are thicker than those of a map with exact poses, the
///   scans that made it disagree, and what lies in one direction (an eighth of all azimuths) is
///   shifted as a whole. A scan of all directions averages eight such shifts, a part of one less.
///   Where directions pull the pose apart by more than the noise of their points (a bent map, half
///   of the ranges off), that counts too.
/// - **motion left in the scan.** Nothing says of a scan without times that it was deskewed, and
///   slow motion does not make it fit clearly worse. The scan itself tells a twist, as far as it
///   can; what it leaves open, and a share of what it found, draws the pose.
/// - **calibration**, 1.2 mm along x and y.
///
/// @param rows  of all points at the pose, as for `covariance_of`; of a sensor that turns about z
/// ten times a second.
[[nodiscard]] Matrix6d covariance_of_shared_errors(const ResidualRows& rows,
                                                   const Eigen::Isometry3d& T_index_lidar,
                                                   float kernel_m, MotionLeft motion_left);

}  // namespace stillmap::localization
