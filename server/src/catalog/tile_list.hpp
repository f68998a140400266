#pragma once

#include <stillmap/maps/map_package.hpp>

#include <Eigen/Geometry>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

namespace stillmap::server {

/// Some of the tiles of a package, which are numbered from 1: by region, and in it by x, then y.
struct TilePage {
  /// The highest number first.
  std::vector<maps::TileEntry> tiles;
  /// Tiles with lower numbers follow; nothing when there are none.
  std::optional<std::int64_t> next;
};

/// @param area    x, y relative to the map's origin [m]: tiles whose bounds touch it; all without.
/// @param before  tiles with lower numbers; all without.
[[nodiscard]] TilePage list_tiles(const maps::MapPackage& map,
                                  const std::optional<Eigen::AlignedBox2d>& area, std::size_t limit,
                                  std::optional<std::int64_t> before);

}  // namespace stillmap::server
