#pragma once

#include "pipeline/build.hpp"

#include <stillmap/maps/map_tile.hpp>
#include <stillmap/maps/region.hpp>

#include <Eigen/Geometry>

#include <cstddef>
#include <set>
#include <vector>

namespace stillmap::mapping {

/// The share of the map that a finish unit makes.
struct UnitRegions {
  std::set<maps::RegionId> regions;
  /// By ordinal: those that may have points in the regions' tiles or in tiles that touch these.
  std::vector<std::size_t> scans;
  /// Of these, those whose sensor stands in one of the regions: the unit answers for them.
  std::set<std::size_t> own_scans;
  /// Where these scans may ask for the ground; local frame [m].
  Eigen::AlignedBox2d ground;

  /// Whether a tile lies in one of the regions, or touches such a tile.
  [[nodiscard]] bool needs(maps::TileId tile) const;
};

/// Farthest that a point of a scan may lie from its pose, seen from above [m]. Points are measured
/// from where the sensor is in its sweep, which is between the poses around.
[[nodiscard]] double reach_m(const Build& build, std::size_t scan);

/// The regions that scans may have points in, by x, then y, in shares of about as many scans.
/// @param build  with its scans selected. @return one a unit, some perhaps empty.
[[nodiscard]] std::vector<UnitRegions> regions_of_units(const Build& build, std::size_t units);

}  // namespace stillmap::mapping
