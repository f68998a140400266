#pragma once

#include "index/map_level.hpp"
#include "query.hpp"

#include <Eigen/Geometry>

#include <cstddef>
#include <span>

namespace stillmap::localization {

/// How well a pose explains a scan.
struct Support {
  /// Share of all points that lie on the map's surfaces.
  double inlier_ratio = 0.0;
  /// Root mean square distance of the inliers to their surface [m].
  double rmse_m = 0.0;
  /// Points that stand and lie where the map knows anything, and the share of all standing points.
  std::size_t known_standing = 0;
  double known_ratio = 0.0;
  /// Share of the known standing points that lie on the map: unlike ground, these do not fit
  /// anywhere.
  double standing_ratio = 0.0;
  /// `inlier_ratio` of the points that have a voxel of the finest level around them.
  double known_inlier_ratio = 0.0;

  /// What candidates are compared by: mostly what stands, and a little of all.
  [[nodiscard]] double score() const { return standing_ratio * known_ratio + 0.1 * inlier_ratio; }
};
/// @param levels  of a map, coarse to fine, at least one.
[[nodiscard]] Support support_of(std::span<const MapIndex::Level> levels, const Query& query,
                                 const Eigen::Isometry3d& T_index_lidar, std::size_t stride = 1);

/// `Support::score` of a pose, or 0 where it is less than `least`: of most such poses some of the
/// points tell that.
[[nodiscard]] double score_above(double least, std::span<const MapIndex::Level> levels,
                                 const Query& query, const Eigen::Isometry3d& T_index_lidar,
                                 std::size_t stride);

}  // namespace stillmap::localization
