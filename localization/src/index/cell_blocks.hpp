#pragma once

#include <array>
#include <bit>
#include <compare>
#include <cstddef>
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

  /// Numbers of some of eight cells.
  struct Numbers {
    std::array<std::uint32_t, 8> of{};
    std::size_t count = 0;
  };
  /// Those of the occupied ones among the cells (x, y, z) to (x + 1, y + 1, z + 1); blocks in
  /// ascending order of x, y, z, cells of a block in the order of their bits.
  [[nodiscard]] Numbers eight(std::int32_t x, std::int32_t y, std::int32_t z) const {
    Numbers numbers;
    for_blocks_of_eight(x, y, z, [&](const Span& bx, const Span& by, const Span& bz) {
      const Slot* block = block_of(bx.first, by.first, bz.first);
      if (block == nullptr) return;
      const std::uint64_t wanted = kCellsOfX[bx.cells] & kCellsOfY[by.cells] & kCellsOfZ[bz.cells];
      for (std::uint64_t left = block->mask & wanted; left != 0; left &= left - 1) {
        const std::uint32_t found =
            number(*block, static_cast<std::uint32_t>(std::countr_zero(left)));
        if (found != kNone) numbers.of[numbers.count++] = found;
      }
    });
    return numbers;
  }

  /// Asks for the memory that `eight` will read.
  void prefetch_eight(std::int32_t x, std::int32_t y, std::int32_t z) const {
    for_blocks_of_eight(x, y, z, [&](const Span& bx, const Span& by, const Span& bz) {
      const Tile* tile = tile_of(tile_number(bx.first, by.first));
      if (tile == nullptr) return;
      const std::uint32_t key = key_in_tile(bx.first, by.first, bz.first);
      __builtin_prefetch(slots_ + tile->first_slot + (mixed(key) >> tile->shift));
    });
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
  /// Cells c and c + 1 of one axis as far as they lie in one block: its first of them, and which of
  /// its four they are, as bits.
  struct Span {
    std::int32_t first = 0;
    std::uint32_t cells = 0;
  };
  struct Spans {
    std::array<Span, 2> of;
    std::size_t count = 0;
    explicit Spans(std::int32_t c) {
      const std::uint32_t two = 3U << (static_cast<std::uint32_t>(c) & 3U);
      // Beside the grid's first cell there is none.
      if (c >= 0) of[count++] = {c, two & 15U};
      if ((c & 3) == 3) of[count++] = {c + 1, 1U};
    }
  };
  template <typename Visit>
  static void for_blocks_of_eight(std::int32_t x, std::int32_t y, std::int32_t z,
                                  const Visit& visit) {
    const Spans xs(x), ys(y), zs(z);
    for (std::size_t i = 0; i < xs.count; ++i) {
      for (std::size_t j = 0; j < ys.count; ++j) {
        for (std::size_t k = 0; k < zs.count; ++k) {
          if (is_cell(xs.of[i].first, ys.of[j].first, zs.of[k].first))
            visit(xs.of[i], ys.of[j], zs.of[k]);
        }
      }
    }
  }
  /// Bits of a block's mask by which of the four cells of an axis are meant.
  static constexpr std::array<std::uint64_t, 16> spread(std::uint64_t one, std::uint32_t step) {
    std::array<std::uint64_t, 16> out{};
    for (std::uint32_t cells = 0; cells < 16; ++cells) {
      for (std::uint32_t k = 0; k < 4; ++k) {
        if ((cells >> k & 1U) != 0) out[cells] |= one << (k * step);
      }
    }
    return out;
  }
  static const std::array<std::uint64_t, 16> kCellsOfX, kCellsOfY, kCellsOfZ;

  /// std::popcount is a call where the instruction cannot be taken for granted.
  [[nodiscard]] static constexpr std::uint32_t bits_of(std::uint64_t v) {
    v -= v >> 1 & 0x5555555555555555U;
    v = (v & 0x3333333333333333U) + (v >> 2 & 0x3333333333333333U);
    v = (v + (v >> 4)) & 0x0F0F0F0F0F0F0F0FU;
    return static_cast<std::uint32_t>(v * 0x0101010101010101U >> 56);
  }

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
    const std::uint32_t found = block.first + bits_of(block.mask & (here - 1));
    return found < cells_ ? found : kNone;
  }

  const Tile* tiles_ = nullptr;
  const Slot* slots_ = nullptr;
  std::uint32_t tile_mask_ = 0;
  std::uint32_t tile_shift_ = 0;
  std::uint32_t cells_ = 0;
};

inline constexpr std::array<std::uint64_t, 16> CellBlocks::kCellsOfX = spread(0xFFFFU, 16);
inline constexpr std::array<std::uint64_t, 16> CellBlocks::kCellsOfY =
    spread(0x000F000F000F000FU, 4);
inline constexpr std::array<std::uint64_t, 16> CellBlocks::kCellsOfZ =
    spread(0x1111111111111111U, 1);

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
