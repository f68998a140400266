#pragma once

#include <stillmap/maps/map_package.hpp>

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
  /// x, y relative to the tile's corner, z to the base [m].
  std::vector<MapPoint> points;
  /// One a point, or empty.
  std::vector<TilePointHistory> history;
};

/// Steps of coordinates in a tile: 20 m / 2^16 in x and y, 2^-11 m in z. A coordinate is the middle
/// of its step, so it is off by at most half of one: 0.15 mm in x and y, 0.25 mm in z. All are
/// exact in floats, relative to the tile.
inline constexpr double kTileStepM = kTileSizeM / 65536.0;
inline constexpr double kTileStepZM = 1.0 / 2048.0;

/// A coordinate in a tile [m] -> the middle of its step. What lies outside of [0, 20 m) by a
/// rounding is taken for the first or last step.
[[nodiscard]] float in_tile_steps(double value_m);
/// A height above the tile's base [m] -> the middle of its step.
/// @throws std::invalid_argument beyond 2^31 steps.
[[nodiscard]] float in_height_steps(double value_m);

/// Bytes of a tile as maps/package.md has them. What is not in steps is put there.
/// @throws std::invalid_argument for a tile without points, more than 2^32 - 1, a number that is
/// not finite, or a history of another size.
[[nodiscard]] std::vector<std::byte> encode_tile(const TileContent& tile);

/// @param name  of the tile, for messages. @param with_history  whether that is wanted, too.
/// @throws InputError for bytes that are no tile: nothing in them is trusted.
[[nodiscard]] TileContent decode_tile(std::span<const std::byte> bytes, const std::string& name,
                                      bool with_history = true);

}  // namespace stillmap::maps
