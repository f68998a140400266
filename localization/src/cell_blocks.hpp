#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "voxel_table.hpp"

namespace stillmap::localization {

/// Numbers of occupied cells, by blocks of 4 x 4 x 4: the eight cells around a point lie in two
/// blocks on average, so that they cost two look-ups, not eight. Cells are numbered in the order of
/// their blocks' keys, and within a block of their bits.
///
/// A view into `CellBlockTable` or a mapped file. Blocks lie by tiles of 32 x 32 blocks, each with
/// a hash table of its own, so that queries in one part of a map touch the pages of that part only.
/// Whatever the bytes say, a look-up ends and stays inside the spans.
class CellBlocks {
 public:
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

  /// What cells are numbered by: first the block, then the bit in it.
  struct Place {
    std::uint64_t block = 0;
    std::uint32_t bit = 0;
    auto operator<=>(const Place&) const = default;
  };
  [[nodiscard]] static constexpr Place place_of(std::int32_t x, std::int32_t y, std::int32_t z) {
    return {cell_key(x >> 2, y >> 2, z >> 2),
            static_cast<std::uint32_t>(((x & 3) << 4) | ((y & 3) << 2) | (z & 3))};
  }

  /// Hash table of one tile, by tile number; `slots` is 0 where there is none, else a power of two.
  struct Tile {
    std::uint32_t number = 0;
    std::uint32_t first_slot = 0;
    std::uint32_t slots = 0;
    /// `shift_of(slots)`.
    std::uint32_t shift = 0;
  };
  /// One block: its key inside the tile, its cells, and the number of the first; an empty slot has
  /// no cell.
  struct Slot {
    std::uint32_t key = 0;
    std::uint32_t first = 0;
    std::uint64_t mask = 0;
  };
  static_assert(sizeof(Tile) == 16 && sizeof(Slot) == 16);

  CellBlocks() = default;
  /// @param tiles  a power of two of them, linear probing; each one's slots lie inside `slots`.
  /// @param cells  how many there are; no number reaches it.
  CellBlocks(std::span<const Tile> tiles, std::span<const Slot> slots, std::uint32_t cells)
      : tiles_(tiles.data()),
        slots_(slots.data()),
        tile_mask_(static_cast<std::uint32_t>(tiles.size()) - 1),
        tile_shift_(shift_of(tiles.size())),
        cells_(cells) {}

  /// Number of the cell, `kNone` when it is empty; coordinates must be those of a cell.
  [[nodiscard]] std::uint32_t find(std::int32_t x, std::int32_t y, std::int32_t z) const {
    const Slot* block = block_of(x, y, z);
    return block == nullptr ? kNone : number(*block, place_of(x, y, z).bit);
  }

  /// Calls `visit(number)` for every occupied one of the cells (x, y, z) to (x + 1, y + 1, z + 1),
  /// x slowest.
  template <typename Visit>
  void for_eight(std::int32_t x, std::int32_t y, std::int32_t z, const Visit& visit) const {
    // Blocks by whether the upper neighbour on an axis lies in the next one.
    std::array<const Slot*, 8> known{};
    std::array<bool, 8> looked{};
    for (std::int32_t corner = 0; corner < 8; ++corner) {
      const std::int32_t cx = x + (corner >> 2);
      const std::int32_t cy = y + ((corner >> 1) & 1);
      const std::int32_t cz = z + (corner & 1);
      if (!is_cell(cx, cy, cz)) continue;
      const auto which = static_cast<std::size_t>(((cx >> 2) != (x >> 2) ? 4 : 0) |
                                                  ((cy >> 2) != (y >> 2) ? 2 : 0) |
                                                  ((cz >> 2) != (z >> 2) ? 1 : 0));
      if (!looked[which]) {
        looked[which] = true;
        known[which] = block_of(cx, cy, cz);
      }
      if (known[which] == nullptr) continue;
      const std::uint32_t found = number(*known[which], place_of(cx, cy, cz).bit);
      if (found != kNone) visit(found);
    }
  }

  /// Tile of a cell: 14 bits an axis, no height.
  [[nodiscard]] static constexpr std::uint32_t tile_number(std::int32_t x, std::int32_t y) {
    return (static_cast<std::uint32_t>(x) >> 7 << 14) | (static_cast<std::uint32_t>(y) >> 7);
  }
  /// Block of a cell inside its tile: 5, 5 and 19 bits.
  [[nodiscard]] static constexpr std::uint32_t key_in_tile(std::int32_t x, std::int32_t y,
                                                           std::int32_t z) {
    return ((static_cast<std::uint32_t>(x) >> 2 & 31U) << 24) |
           ((static_cast<std::uint32_t>(y) >> 2 & 31U) << 19) | static_cast<std::uint32_t>(z) >> 2;
  }
  /// Fibonacci hashing: the top bits of the product mix all bits of the key.
  [[nodiscard]] static constexpr std::uint32_t mixed(std::uint32_t key) {
    return key * 0x9E3779B1U;
  }
  /// What leaves of a mixed key a place in a table of so many, a power of two above 1.
  [[nodiscard]] static constexpr std::uint32_t shift_of(std::size_t size) {
    return static_cast<std::uint32_t>(32 - std::countr_zero(size));
  }

 private:
  [[nodiscard]] const Slot* block_of(std::int32_t x, std::int32_t y, std::int32_t z) const {
    const Tile* tile = tile_of(tile_number(x, y));
    if (tile == nullptr) return nullptr;
    const std::uint32_t key = key_in_tile(x, y, z);
    const Slot* slots = slots_ + tile->first_slot;
    const std::uint32_t last = tile->slots - 1;
    std::uint32_t slot = mixed(key) >> tile->shift;
    for (std::uint32_t tried = 0; tried <= last; ++tried, slot = (slot + 1) & last) {
      if (slots[slot].mask == 0) return nullptr;
      if (slots[slot].key == key) return &slots[slot];
    }
    return nullptr;
  }
  [[nodiscard]] const Tile* tile_of(std::uint32_t number) const {
    if (tiles_ == nullptr) return nullptr;
    std::uint32_t at = mixed(number) >> tile_shift_;
    for (std::uint32_t tried = 0; tried <= tile_mask_; ++tried, at = (at + 1) & tile_mask_) {
      if (tiles_[at].slots == 0) return nullptr;
      if (tiles_[at].number == number) return &tiles_[at];
    }
    return nullptr;
  }
  [[nodiscard]] std::uint32_t number(const Slot& block, std::uint32_t bit) const {
    const std::uint64_t here = std::uint64_t{1} << bit;
    if ((block.mask & here) == 0) return kNone;
    const std::uint32_t found =
        block.first + static_cast<std::uint32_t>(std::popcount(block.mask & (here - 1)));
    return found < cells_ ? found : kNone;
  }

  const Tile* tiles_ = nullptr;
  const Slot* slots_ = nullptr;
  std::uint32_t tile_mask_ = 0;
  std::uint32_t tile_shift_ = 0;
  std::uint32_t cells_ = 0;
};

/// What `CellBlocks` looks into, made from the cells.
class CellBlockTable {
 public:
  /// @param places  of all occupied cells, ascending, each once; fewer than `CellBlocks::kNone`.
  explicit CellBlockTable(std::span<const CellBlocks::Place> places);

  [[nodiscard]] CellBlocks view() const { return {tiles_, slots_, cells_}; }
  /// Hash table by tile number.
  [[nodiscard]] std::span<const CellBlocks::Tile> tiles() const { return tiles_; }
  /// Those of one tile stand together, tiles in ascending order.
  [[nodiscard]] std::span<const CellBlocks::Slot> slots() const { return slots_; }

 private:
  std::vector<CellBlocks::Tile> tiles_;
  std::vector<CellBlocks::Slot> slots_;
  std::uint32_t cells_ = 0;
};

}  // namespace stillmap::localization
