#pragma once

#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/tile_steps.hpp>

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace stillmap::maps {

/// A scan by its source and its number in that source, so that a new source leaves the numbers of
/// the others alone.
struct SourceScan {
  std::uint32_t source = 0;
  std::uint32_t scan = 0;
  auto operator<=>(const SourceScan&) const = default;
};

/// What is known of a point besides what a viewer needs.
struct TilePointHistory {
  SourceScan first, last;
  /// As `PointHistory`.
  std::uint32_t object = 0;
  std::array<std::int8_t, 3> normal{};
  std::uint8_t planarity = 0;
};

/// The content of a tile.
struct TileContent {
  /// Added to the points' z gives the map frame [m].
  std::int32_t z_base_m = 0;
  /// x, y relative to the tile's corner, z to the base [m]; `encode_tile` puts them in steps
  /// (`tile_steps.hpp`).
  std::vector<MapPoint> points;
  /// One a point, or empty.
  std::vector<TilePointHistory> history;
};

/// Bytes of a tile as maps/package.md has them.
/// @throws std::invalid_argument for a tile without points, more than 2^32 - 1, a number that is
/// not finite, or a history of another size.
[[nodiscard]] std::vector<std::byte> encode_tile(const TileContent& tile);

/// Whether the bytes of a tile hold histories. @throws InputError as below.
[[nodiscard]] bool has_history(std::span<const std::byte> tile, const std::string& name);

/// @param name  of the tile, for messages. @param with_history  whether that is wanted, too.
/// @throws InputError for bytes that are no tile: nothing in them is trusted.
[[nodiscard]] TileContent decode_tile(std::span<const std::byte> bytes, const std::string& name,
                                      bool with_history = true);

}  // namespace stillmap::maps
