#pragma once

#include <stillmap/maps/region.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace stillmap::maps {

using Sha256Bytes = std::array<std::byte, 32>;

/// A file that holds tiles of a region, one behind the other. It never changes.
struct Pack {
  std::uint64_t bytes = 0;
  Sha256Bytes sha256{};
};

/// Where a tile lies, and what is known of it without reading it.
struct RegionTile {
  /// In the region, below 32.
  std::uint8_t x = 0, y = 0;
  /// Which of the region's packs.
  std::uint16_t pack = 0;
  std::uint32_t points = 0;
  /// Of its bytes in the pack.
  std::uint64_t offset = 0;
  std::uint32_t bytes = 0;
  /// As in the tile's head.
  std::int32_t z_base_m = 0;
  /// Lowest and highest steps of its points (`tile_bytes.hpp`): x, y, then z.
  std::array<std::uint16_t, 2> min_xy{}, max_xy{};
  std::int32_t min_z = 0, max_z = 0;
  /// Of its bytes: what the tile is.
  Sha256Bytes sha256{};
};
static_assert(sizeof(RegionTile) == 72);

/// What a region of 32 x 32 tiles holds, where it lies.
struct RegionNode {
  std::span<const Pack> packs;
  /// By x, then y.
  std::span<const RegionTile> tiles;
};

/// Bytes of a region as maps/package.md has them; equal for equal content.
/// @throws std::invalid_argument for what `decode_region` would refuse.
[[nodiscard]] std::vector<std::byte> encode_region(const RegionNode& region);

/// @param bytes  at a multiple of 8; the region lies in them. @param name  of the file, for
/// messages.
/// @throws InputError for bytes that are no region: nothing in them is trusted.
[[nodiscard]] RegionNode decode_region(std::span<const std::byte> bytes, const std::string& name);

}  // namespace stillmap::maps
