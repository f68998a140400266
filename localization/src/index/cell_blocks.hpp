#pragma once

#include "voxel.hpp"
#include "voxel_table.hpp"

#include <Eigen/Core>

#include <array>
#include <bit>
#include <compare>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace stillmap::localization {

/// Voxels by their cells, in blocks of 4 x 4 x 4 cells: the eight cells around a point lie in two
/// blocks on average, so that they cost two look-ups, not eight. Blocks lie by tiles of at most 32
/// x 32 blocks, each with a hash table of its own.
///
/// It looks into one or more parts, which lie in mapped files or in memory, and puts them beside
/// each other: each part counts its cells and its means from its own corner. Whatever the parts'
/// bytes say, a look-up ends and stays inside them.
class CellBlocks {
 public:
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

  /// Hash table of one tile; `slots` is a power of two above 1.
  struct Tile {
    /// Of the part: x, y.
    std::uint16_t x = 0, y = 0;
    std::uint32_t first_slot = 0;
    std::uint32_t slots = 0;
    /// `shift_of(slots)`.
    std::uint32_t shift = 0;
  };
  /// One block: its key inside the tile, its cells, and the number of the first one's voxel; an
  /// empty slot has no cell.
  struct Slot {
    std::uint32_t key = 0;
    std::uint32_t first = 0;
    std::uint64_t mask = 0;
  };
  static_assert(sizeof(Tile) == 16 && sizeof(Slot) == 16);

  struct Part {
    /// Each tile's slots lie inside `slots`; no tile comes twice.
    std::span<const Tile> tiles;
    std::span<const Slot> slots;
    /// By block, then bit.
    std::span<const Voxel> voxels;
    /// Where the part's cells begin: x, y multiples of a tile's side, z of 4.
    Eigen::Array3i first_cell = Eigen::Array3i::Zero();
  };

  CellBlocks() = default;
  /// @param parts       the bytes that they look into outlive this; their tiles do not overlap.
  /// @param tile_shift  binary logarithm of a tile's side in cells, in [2, 7].
  CellBlocks(std::span<const Part> parts, int tile_shift, float edge_m);

  [[nodiscard]] std::size_t voxel_count() const { return voxel_count_; }

  /// A tile as it is looked up.
  struct TileView {
    const Slot* slots = nullptr;
    const Voxel* voxels = nullptr;
    /// Of its part's corner [m].
    Eigen::Vector3f corner = Eigen::Vector3f::Zero();
    std::int32_t first_z = 0;
    std::uint32_t last_slot = 0;
    std::uint32_t shift = 0;
    std::uint32_t voxel_count = 0;
  };

  /// Some of eight voxels, each with its tile; only the first `count` are set.
  struct Eight {
    std::array<const Voxel*, 8> voxels;
    std::array<const TileView*, 8> tiles;
    std::size_t count = 0;
  };
  /// Those of the cells (x, y, z) to (x + 1, y + 1, z + 1); blocks in ascending order of x, y, z,
  /// cells of a block in the order of their bits.
  [[nodiscard]] Eight eight(std::int32_t x, std::int32_t y, std::int32_t z) const {
    Eight found;
    for_blocks_of_eight(x, y, z, [&](const TileView& tile, std::uint32_t key, std::uint64_t cells) {
      const Slot* block = block_of(tile, key);
      if (block == nullptr) return;
      for (std::uint64_t left = block->mask & cells; left != 0; left &= left - 1) {
        const Voxel* voxel = voxel_of_bit(tile, *block, left & (0 - left));
        if (voxel == nullptr) continue;
        found.voxels[found.count] = voxel;
        found.tiles[found.count++] = &tile;
      }
    });
    return found;
  }

  /// Asks for the memory that `eight` will read.
  void prefetch_eight(std::int32_t x, std::int32_t y, std::int32_t z) const {
    for_blocks_of_eight(x, y, z, [&](const TileView& tile, std::uint32_t key, std::uint64_t) {
      __builtin_prefetch(tile.slots + (mixed(key) >> tile.shift));
    });
  }

  /// Calls `visit(cell, voxel, tile)` for the voxels of the blocks that touch the cells from `low`
  /// to `high`, both included, on the ground: more than asked for.
  template <typename Visit>
  void for_each_near(const Eigen::Array2i& low, const Eigen::Array2i& high,
                     const Visit& visit) const {
    const auto clamped = [](std::int32_t at, std::uint32_t count) {
      return std::clamp<std::int32_t>(at, 0, static_cast<std::int32_t>(count));
    };
    const std::int32_t last_x = clamped((high.x() >> tile_shift_) - first_x_ + 1, tiles_x_);
    const std::int32_t last_y = clamped((high.y() >> tile_shift_) - first_y_ + 1, tiles_y_);
    for (auto x = clamped((low.x() >> tile_shift_) - first_x_, tiles_x_); x < last_x; ++x) {
      for (auto y = clamped((low.y() >> tile_shift_) - first_y_, tiles_y_); y < last_y; ++y) {
        const std::uint32_t at =
            static_cast<std::uint32_t>(x) * tiles_y_ + static_cast<std::uint32_t>(y);
        if (tile_at_[at] == kNone) continue;
        const Eigen::Array2i first_cell((x + first_x_) << tile_shift_, (y + first_y_)
                                                                           << tile_shift_);
        visit_tile(tiles_[tile_at_[at]], first_cell, low, high, visit);
      }
    }
  }

  /// What leaves of a mixed key a place in a table of so many, a power of two above 1.
  [[nodiscard]] static constexpr std::uint32_t shift_of(std::size_t size) {
    return static_cast<std::uint32_t>(32 - std::countr_zero(size));
  }
  /// Fibonacci hashing: the top bits of the product mix all bits of the key.
  [[nodiscard]] static constexpr std::uint32_t mixed(std::uint32_t key) {
    return key * 0x9E3779B1U;
  }
  /// Key of a block inside its tile, from its place there: 5, 5 and 19 bits.
  [[nodiscard]] static constexpr std::uint32_t key_in_tile(std::uint32_t x, std::uint32_t y,
                                                           std::uint32_t z) {
    return x << 24 | y << 19 | z;
  }

 private:
  static constexpr std::uint16_t kNone = 0xFFFF;
  static constexpr std::uint32_t kBlocksOfHeight = 1U << 19U;

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
      of[count++] = {c, two & 15U};
      if ((c & 3) == 3) of[count++] = {c + 1, 1U};
    }
  };
  /// Calls `visit(tile, key, cells)`, with the wanted cells of the block as bits.
  template <typename Visit>
  void for_blocks_of_eight(std::int32_t x, std::int32_t y, std::int32_t z,
                           const Visit& visit) const {
    const Spans xs(x), ys(y), zs(z);
    for (std::size_t i = 0; i < xs.count; ++i) {
      for (std::size_t j = 0; j < ys.count; ++j) {
        const TileView* tile = tile_of(xs.of[i].first, ys.of[j].first);
        if (tile == nullptr) continue;
        const std::uint32_t block_x = static_cast<std::uint32_t>(xs.of[i].first) >> 2 & block_mask_;
        const std::uint32_t block_y = static_cast<std::uint32_t>(ys.of[j].first) >> 2 & block_mask_;
        for (std::size_t k = 0; k < zs.count; ++k) {
          const std::uint32_t block_z =
              static_cast<std::uint32_t>(zs.of[k].first - tile->first_z) >> 2;
          if (block_z >= kBlocksOfHeight) continue;
          visit(*tile, key_in_tile(block_x, block_y, block_z),
                kCellsOfX[xs.of[i].cells] & kCellsOfY[ys.of[j].cells] & kCellsOfZ[zs.of[k].cells]);
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

  [[nodiscard]] const TileView* tile_of(std::int32_t x, std::int32_t y) const {
    const auto column = static_cast<std::uint32_t>((x >> tile_shift_) - first_x_);
    const auto row = static_cast<std::uint32_t>((y >> tile_shift_) - first_y_);
    if (column >= tiles_x_ || row >= tiles_y_) return nullptr;
    const std::uint16_t number = tile_at_[column * tiles_y_ + row];
    return number == kNone ? nullptr : &tiles_[number];
  }
  [[nodiscard]] static const Slot* block_of(const TileView& tile, std::uint32_t key) {
    std::uint32_t slot = mixed(key) >> tile.shift;
    for (std::uint32_t tried = 0; tried <= tile.last_slot;
         ++tried, slot = (slot + 1) & tile.last_slot) {
      if (tile.slots[slot].mask == 0) return nullptr;
      if (tile.slots[slot].key == key) return &tile.slots[slot];
    }
    return nullptr;
  }
  /// Null where a damaged file says a number that is none.
  [[nodiscard]] static const Voxel* voxel_of_bit(const TileView& tile, const Slot& block,
                                                 std::uint64_t bit) {
    const std::uint32_t number = block.first + bits_of(block.mask & (bit - 1));
    return number < tile.voxel_count ? tile.voxels + number : nullptr;
  }
  template <typename Visit>
  static void visit_tile(const TileView& tile, const Eigen::Array2i& first_cell,
                         const Eigen::Array2i& low, const Eigen::Array2i& high,
                         const Visit& visit) {
    for (std::uint32_t slot = 0; slot <= tile.last_slot; ++slot) {
      const Slot& block = tile.slots[slot];
      const Eigen::Array3i corner(
          first_cell.x() + static_cast<std::int32_t>(block.key >> 24 & 31U) * 4,
          first_cell.y() + static_cast<std::int32_t>(block.key >> 19 & 31U) * 4,
          tile.first_z + static_cast<std::int32_t>(block.key & (kBlocksOfHeight - 1)) * 4);
      if (corner.x() > high.x() || corner.x() + 3 < low.x() || corner.y() > high.y() ||
          corner.y() + 3 < low.y())
        continue;
      for (std::uint64_t left = block.mask; left != 0; left &= left - 1) {
        const Voxel* voxel = voxel_of_bit(tile, block, left & (0 - left));
        const int bit = std::countr_zero(left);
        if (voxel != nullptr)
          visit(corner + Eigen::Array3i(bit >> 4, bit >> 2 & 3, bit & 3), *voxel, tile);
      }
    }
  }

  std::vector<TileView> tiles_;
  /// Number of the tile at each place of a rectangle, x first.
  std::vector<std::uint16_t> tile_at_;
  std::int32_t first_x_ = 0, first_y_ = 0;
  std::uint32_t tiles_x_ = 0, tiles_y_ = 0;
  int tile_shift_ = 2;
  std::uint32_t block_mask_ = 0;
  std::size_t voxel_count_ = 0;
};

inline constexpr std::array<std::uint64_t, 16> CellBlocks::kCellsOfX = spread(0xFFFFU, 16);
inline constexpr std::array<std::uint64_t, 16> CellBlocks::kCellsOfY =
    spread(0x000F000F000F000FU, 4);
inline constexpr std::array<std::uint64_t, 16> CellBlocks::kCellsOfZ =
    spread(0x1111111111111111U, 1);

/// Tiles and slots of one part, made from its cells.
class CellBlockTable {
 public:
  /// @param places  of all occupied cells, ascending, each once; not negative, fewer than 2^32 - 1.
  CellBlockTable(std::span<const CellBlocks::Place> places, int tile_shift);

  /// By x, then y.
  [[nodiscard]] std::span<const CellBlocks::Tile> tiles() const { return tiles_; }
  /// Those of one tile stand together, in the order of the tiles.
  [[nodiscard]] std::span<const CellBlocks::Slot> slots() const { return slots_; }

 private:
  std::vector<CellBlocks::Tile> tiles_;
  std::vector<CellBlocks::Slot> slots_;
};

}  // namespace stillmap::localization
