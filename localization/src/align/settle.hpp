#pragma once

#include "index/map_level.hpp"
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

/// Share of the scan that a pose explains, by every `stride`-th point: what places are compared by.
[[nodiscard]] double support_at(std::span<const MapIndex::Level> levels, const Query& query,
                                const Eigen::Isometry3d& T_index_lidar, std::size_t stride);

/// Takes a settled place down to the finest level, with as few points, and measures its support
/// anew: what repeats itself every metre or two looks alike on the coarser ones.
void sharpen(std::span<const MapIndex::Level> levels, const Query& query, float bend_share,
             Place& place);

}  // namespace stillmap::localization
