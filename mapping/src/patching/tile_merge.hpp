#pragma once

#include "core/point_cells.hpp"

#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>

#include <cstdint>
#include <vector>

namespace stillmap::mapping {

/// What a map holds of a tile. Scans, objects and drives have the numbers of the patched map.
struct TileOfMap {
  /// From the tile's corner, heights from the map's origin [m].
  std::vector<maps::MapPoint> points;
  /// One a point, or empty.
  std::vector<maps::PointHistory> history;
  maps::TileEvidence evidence;
};

[[nodiscard]] inline Eigen::Vector3f position_of(const maps::MapPoint& point) {
  return {point.x, point.y, point.z};
}

/// What became of points of a tile.
struct PatchCounts {
  /// Of the version before: that stayed, gave way to a point of the new drives at their place, or
  /// stand where these saw free space.
  std::uint64_t kept = 0, replaced = 0, gone = 0;
  /// Of the new drives.
  std::uint64_t added = 0;
};

struct MergedTile {
  TileOfMap tile;
  PatchCounts counts;
};

/// Where new drives have points.
struct NearPoints {
  PointCells measured;
  /// Projected or filled.
  PointCells others;
};

/// A tile of a map and what new drives saw there, as one.
///
/// - A point gives way to a point of the new drives within the tolerance. Measured points give way
///   to measured ones only; a new point that was projected or filled gives way to a measured one
///   that stays.
/// - A measured point above the ground is gone where no new point lies within the tolerance and the
///   new drives saw the four cubes of evidence around it free, in none of which they met anything.
/// - Everything else stays: what the new drives did not see may be as it was.
/// - Of each cube the evidence of the new drives, where they saw it, stands for that of the others.
/// @param near_now     points of `now` and of the tiles around it, as its points count.
/// @param tolerance_m  > 0, at most the edge of the cells of `near_now`.
[[nodiscard]] MergedTile merged(const TileOfMap& before, const TileOfMap& now,
                                const NearPoints& near_now, double tolerance_m);

}  // namespace stillmap::mapping
