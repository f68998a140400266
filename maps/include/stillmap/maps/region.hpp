#pragma once

#include <stillmap/maps/map_tile.hpp>

#include <compare>
#include <cstdint>

namespace stillmap::maps {

/// Tiles of a region along one axis.
inline constexpr int kRegionTiles = 32;
inline constexpr double kRegionSizeM = kRegionTiles * kTileSizeM;

/// x, y of a region: of its tiles, divided by 32.
struct RegionId {
  std::int32_t x = 0;
  std::int32_t y = 0;
  auto operator<=>(const RegionId&) const = default;
};

/// Tiles are numbered by 32 bits.
[[nodiscard]] constexpr bool has_tiles(RegionId region) {
  constexpr std::int32_t kMost = 1 << 26;
  return region.x >= -kMost && region.x < kMost && region.y >= -kMost && region.y < kMost;
}

/// @param tile  of level 0.
[[nodiscard]] constexpr RegionId region_of(TileId tile) {
  // A shift rounds down on both sides of zero.
  static_assert(kRegionTiles == 1 << 5);
  return {tile.x >> 5, tile.y >> 5};
}

}  // namespace stillmap::maps
