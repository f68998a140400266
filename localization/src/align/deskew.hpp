#pragma once

#include "index/map_level.hpp"
#include "query.hpp"
#include "registration.hpp"

#include <Eigen/Geometry>

#include <span>

namespace stillmap::localization {

/// Whether a scan says that its points were not all taken at its stamp.
[[nodiscard]] bool has_times(const Query& query);

/// How the sensor moved while it took a scan.
struct SweepMotion {
  /// (tx ty tz rx ry rz) [m/s, rad/s] in the lidar frame.
  Vector6d twist = Vector6d::Zero();
  /// What the twist's own error adds to the covariance of a pose at the scan's stamp.
  Matrix6d pose_covariance = Matrix6d::Zero();
};

/// Finds the motion during a scan from the map, together with the pose at the scan's stamp, and
/// moves the points there. Does nothing where all were taken there.
///
/// Gauss-Newton for pose and twist at once, coarse to fine and from wide kernels to narrow ones: a
/// point taken t after the stamp goes with the twist t times as far as with the pose. One
/// velocity holds for the sweep (Bosse and Zlot, "Continuous 3D scan-matching with a spinning 2D
/// laser", ICRA 2009; Dellenbach et al., "CT-ICP", ICRA 2022, here against a map that stays). What
/// the scan does not tell of the twist is taken for zero, give or take 15 m/s and 0.5 rad/s.
/// @param levels  of a map, coarse to fine, at least one.
/// @param T_index_lidar  in: where the scan fits best as it came.
[[nodiscard]] SweepMotion deskew(std::span<const MapIndex::Level> levels, Query& query,
                                 Eigen::Isometry3d& T_index_lidar);

/// Gives a scan without times those of a sensor that turns ten times a second, if the map says that
/// it moved as such a one: taken as it came, the scan fits clearly worse. Its stamp is then where
/// the sensor looked along +x. Which way it turned does not matter: the twist has the other sign.
///
/// Walls bent by a map's own errors look like motion, too, but fit little better so.
/// @param T_index_lidar  where the scan fits best as it came.
/// @return whether it did.
[[nodiscard]] bool give_spinning_times(std::span<const MapIndex::Level> levels, Query& query,
                                       const Eigen::Isometry3d& T_index_lidar);

}  // namespace stillmap::localization
