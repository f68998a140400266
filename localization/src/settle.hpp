#pragma once

#include "map_level.hpp"
#include "query.hpp"

#include <Eigen/Geometry>

#include <span>

namespace stillmap::localization {

/// A pose and how much of the scan it explains.
struct Place {
  Eigen::Isometry3d T_index_lidar;
  double support = 0.0;
  int iterations = 0;
};

/// Aligns from a start, coarse to fine above the finest level, with few points: enough to tell good
/// places from bad.
/// @param levels  coarse to fine, at least one.
[[nodiscard]] Place settle(std::span<const MapIndex::Level> levels, const Query& query,
                           const Eigen::Isometry3d& T_index_lidar, float bend_share);

}  // namespace stillmap::localization
