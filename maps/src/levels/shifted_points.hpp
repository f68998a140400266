#pragma once

#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>

#include <cstdint>
#include <set>
#include <utility>
#include <vector>

namespace stillmap::maps {

/// Points of a map in the tiles of level 0 of another one of the same frame.
class ShiftedPoints {
 public:
  /// @param map  outlives this. @throws InputError for origins farther apart than the Earth is
  /// wide.
  ShiftedPoints(const MapPackage& map, const Eigen::Vector3d& origin);

  /// Those tiles that its points may lie in, by x and y.
  [[nodiscard]] std::set<std::pair<std::int32_t, std::int32_t>> tiles() const;
  /// Points of a tile and those within a margin around it [m], from its corner; without a margin,
  /// each point of the map is in one tile.
  [[nodiscard]] std::vector<MapPoint> in_tile(std::int32_t x, std::int32_t y,
                                              double margin_m = 0.0) const;
  /// How many of some points were measured above the ground where the map's drives saw nothing but
  /// free space, and where it has no point.
  /// @param points  of a tile, from its corner.
  [[nodiscard]] std::uint32_t count_seen_free(const std::vector<MapPoint>& points, std::int32_t x,
                                              std::int32_t y) const;

 private:
  const MapPackage& map_;
  Eigen::Vector3d shift_;
};

}  // namespace stillmap::maps
