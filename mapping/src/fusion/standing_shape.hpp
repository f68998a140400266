#pragma once

#include "fusion/obstacle_map.hpp"

#include <stillmap/maps/box.hpp>

#include <cstddef>

namespace stillmap::mapping {

/// What the points of all scans show of a thing that stands.
struct StandingShape {
  /// Voxels in its box, grown by 0.2 m.
  std::size_t voxels = 0;
  /// Height over the ground that 5 % of them are above, up to 4 m [m].
  double top_m = 0.0;
  /// Of the footprint's columns of 0.3 m with a voxel: those with one above 2.3 m and one below
  /// 1.8 m, as under crowns, at walls and trunks.
  double tall_share = 0.0;
  /// Mean planarity of the voxels, in [0, 1].
  double planarity = 0.0;
  /// Share of the voxels below 1.0 m that lie more than 0.4 m from all four sides.
  double inside_share = 0.0;
  /// Voxels in the ring 0.3 to 0.9 m outside, at the heights of a body, against those in the box.
  double ring_ratio = 0.0;
  /// Share of the columns with a voxel that have one between 0.1 and 0.3 m.
  double skirt_share = 0.0;
  /// Share of the footprint's columns with a voxel.
  double covered_share = 0.0;
  /// Of the four sides, how much of their length has a voxel within 0.3 m: mean.
  double outline_share = 0.0;
  /// Mean number of scans that hit a voxel.
  double scans = 0.0;
};

/// How far around its centre a box's shape is looked for [m].
[[nodiscard]] double reach_of_shape_m(const maps::Box& box);

/// @param box  local frame [m]; heights are not used.
[[nodiscard]] StandingShape shape_of(const ObstacleMap& obstacles, const maps::Box& box);

}  // namespace stillmap::mapping
