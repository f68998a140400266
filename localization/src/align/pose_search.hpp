#pragma once

#include "index/map_level.hpp"
#include "query.hpp"

#include <Eigen/Geometry>

#include <cstddef>
#include <vector>

namespace stillmap::localization {

/// How far around the prior poses are tried.
struct SearchWindow {
  /// Horizontal, to each side along the map's axes [m], >= 0.
  double radius_m = 0.0;
  /// Yaw to each side [rad], >= 0.
  double yaw_rad = 0.0;
  /// Up and down to other floors that fit as well as the prior's own [m], >= 0.
  double height_m = 0.0;
  /// See `search_poses`, >= 1.
  std::size_t max_candidates = 3;
};

/// Counts hits of standing points in the map's occupied cells for every pose on a grid of the
/// level's edge and 2 deg around the prior, and returns the best places, best first, the same place
/// only once.
///
/// Correlative matching as in Olson, "Real-Time Correlative Scan Matching", ICRA 2009, on 3D cells.
/// Needs no derivative, so it sees past the local optima that trap every gradient method from 2 m /
/// 10 deg. Ties go to the pose nearest to the prior. Above and below a place each floor that what
/// does not stand fits on is another one.
/// @param level   about 1 m.  @param origin  the index's.
/// @return T_map_lidar of the best `max_candidates` places, up to twice as many elsewhere that are
/// almost as good as the first, and those on other floors of the best; the
/// prior alone when nothing stands in the scan.
[[nodiscard]] std::vector<Eigen::Isometry3d> search_poses(
    const MapIndex::Level& level, const Eigen::Vector3d& origin, const Query& query,
    const Eigen::Isometry3d& T_map_lidar_prior, const SearchWindow& window);

}  // namespace stillmap::localization
