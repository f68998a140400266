#pragma once

#include <stillmap/maps/tile_evidence.hpp>
#include <stillmap/maps/tile_steps.hpp>
#include "package/drive_numbers.hpp"

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace stillmap::maps {

/// What is known of a point besides what a viewer needs.
struct TilePointHistory {
  DriveNumber first, last;
  /// As `PointHistory`.
  std::array<std::int8_t, 3> normal{};
  std::uint8_t planarity = 0;
};

/// A point that belongs to an object.
struct TilePointOfObject {
  std::uint32_t point = 0;
  DriveNumber object;
};

/// The content of a tile.
struct TileContent {
  /// Added to the points' z gives the map frame [m].
  std::int32_t z_base_m = 0;
  /// x, y relative to the tile's corner, z to the base [m]; `encode_tile` puts them in steps
  /// (`tile_steps.hpp`). Of which objects they are is told below.
  std::vector<MapPoint> points;
  /// By point.
  std::vector<TilePointOfObject> of_objects;
  /// One a point, or empty.
  std::vector<TilePointHistory> history;
  TileEvidence evidence;
};

/// Bytes of a tile as maps/package.md has them.
/// @throws std::invalid_argument for a tile without points, more than 2^32 - 1, a number that is
/// not finite, a history of another size, objects of points or drives of the evidence out of their
/// order.
[[nodiscard]] std::vector<std::byte> encode_tile(const TileContent& tile);

/// Whether the bytes of a tile hold histories. @throws InputError as below.
[[nodiscard]] bool has_history(std::span<const std::byte> tile, const std::string& name);

/// Of a tile. @throws InputError as below.
[[nodiscard]] TileEvidence decode_evidence(std::span<const std::byte> tile,
                                           const std::string& name);

/// @param name  of the tile, for messages. @param with_history  whether histories and evidence are
/// wanted, too.
/// @throws InputError for bytes that are no tile: nothing in them is trusted.
[[nodiscard]] TileContent decode_tile(std::span<const std::byte> bytes, const std::string& name,
                                      bool with_history = true);

}  // namespace stillmap::maps
