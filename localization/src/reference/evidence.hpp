#pragma once

#include "align/judge.hpp"
#include "reference/terms.hpp"

#include <vector>

namespace stillmap::localization {

/// How well a pose explains a scan: a point lies on the map when it is within 0.2 m of the surface
/// at its nearest map point, or of 0.3 m of that point itself where there is no surface; the map
/// knows a place within `kMaxPairDistanceM` of a point.
/// @param stands  one flag a point, see `standing_flags`.
[[nodiscard]] Support support_at(const MapPoints& map,
                                 const std::vector<Eigen::Vector3f>& points_lidar,
                                 const std::vector<char>& stands,
                                 const Eigen::Isometry3d& T_local_lidar);

/// Covariance of a pose, and the directions that its terms leave open.
struct Uncertainty {
  Matrix6d covariance = Matrix6d::Zero();
  std::vector<Vector6d> degenerate;
};
/// H^-1 (sum_b g_b g_b^T) H^-1 over blocks b of 4 m, whose points share their errors (Huber's
/// sandwich, clustered), the map's own thickness, and a floor for what all points share.
///
/// H counts distances along the map's normals only, also for `icp`: when the scan slides along a
/// surface its points pair up anew, so its distances to single points do not hold it. The gradient
/// g is of whatever the method minimises. A direction with little of H's information a term is
/// degenerate and gets 10 m.
/// @param terms  at T_local_lidar.
[[nodiscard]] Uncertainty uncertainty_of(const std::vector<Term>& terms,
                                         const Eigen::Isometry3d& T_local_lidar);

}  // namespace stillmap::localization
