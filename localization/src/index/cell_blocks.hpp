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

  /// A block in which some of the eight cells around a point are looked for.
  struct Wanted {
    const TileView* tile;
    /// Where the block is looked for first.
    const Slot* slot;
    /// Those of the eight, as bits.
    std::uint64_t cells;
    std::uint32_t key;
    /// Number of the point.
    std::uint32_t point;
  };
  /// Blocks of the cells (x, y, z) to (x + 1, y + 1, z + 1), in ascending order of x, y, z. Asks
  /// for the memory of their slots.
  /// @param to  room for eight. @return where the next one goes.
  Wanted* blocks_of_eight(std::int32_t x, std::int32_t y, std::int32_t z, std::uint32_t point,
                          Wanted* to) const {
    // A bit for each axis along which the two cells lie in two blocks: all subsets of these bits
    // are visited. One loop, as each end of a loop is mispredicted.
    const auto in_block = [](std::int32_t c) { return static_cast<std::uint32_t>(c) & 3U; };
    const std::uint32_t across =
        (in_block(x) + 1U) >> 2 << 2 | (in_block(y) + 1U) >> 2 << 1 | (in_block(z) + 1U) >> 2;
    std::uint32_t next = 0;
    do {
      const std::uint32_t dx = next >> 2, dy = next >> 1 & 1U, dz = next & 1U;
      next = (next - across) & across;
      const auto block_x = (x >> 2) + static_cast<std::int32_t>(dx);
      const auto block_y = (y >> 2) + static_cast<std::int32_t>(dy);
      const TileView* tile = tile_of(block_x, block_y);
      if (tile == nullptr) continue;
      const std::uint32_t block_z =
          static_cast<std::uint32_t>(z + static_cast<std::int32_t>(dz) - tile->first_z) >> 2;
      if (block_z >= kBlocksOfHeight) continue;
      const std::uint32_t key =
          key_in_tile(static_cast<std::uint32_t>(block_x) & block_mask_,
                      static_cast<std::uint32_t>(block_y) & block_mask_, block_z);
      const Slot* slot = tile->slots + (mixed(key) >> tile->shift);
      __builtin_prefetch(slot);
      *to++ = {tile, slot,
               kCellsOfX[cells_of(in_block(x), dx)] & kCellsOfY[cells_of(in_block(y), dy)] &
                   kCellsOfZ[cells_of(in_block(z), dz)],
               key, point};
    } while (next != 0);
    return to;
  }
  /// Those of its wanted cells that a block has, as bits; `slot` is the block's then.
  [[nodiscard]] static std::uint64_t cells_in(Wanted& block) {
    const auto is_other = [&] {
      return static_cast<bool>(static_cast<int>(block.slot->key != block.key) &
                               static_cast<int>(block.slot->mask != 0));
    };
    const TileView& tile = *block.tile;
    for (std::uint32_t tried = 0; is_other() && tried <= tile.last_slot; ++tried) {
      const auto next = static_cast<std::uint32_t>(block.slot - tile.slots) + 1;
      block.slot = tile.slots + (next & tile.last_slot);
    }
    const std::uint64_t is_block = block.slot->key == block.key ? 1 : 0;
    return block.slot->mask & block.cells & (0 - is_block);
  }
  /// Whether a part has all voxels that a block speaks of: a damaged file may not.
  [[nodiscard]] static bool is_whole(const TileView& tile, const Slot& block) {
    return std::uint64_t{block.first} + bits_of(block.mask) <= tile.voxel_count;
  }
  /// Number of a cell's voxel in its part. @param bit  of the cell.
  [[nodiscard]] static std::uint32_t number_of(const Slot& block, std::uint64_t bit) {
    return block.first + bits_of(block.mask & (bit - 1));
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

  /// Which of a block's four cells along an axis are c and c + 1, as bits: of the block of c, or of
  /// the one behind it.
  static constexpr std::uint32_t cells_of(std::uint32_t c, std::uint32_t behind) {
    return 3U << c >> 4 * behind & 15U;
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

  /// @param x, y  of a block.
  [[nodiscard]] const TileView* tile_of(std::int32_t x, std::int32_t y) const {
    const auto column = static_cast<std::uint32_t>((x >> (tile_shift_ - 2)) - first_x_);
    const auto row = static_cast<std::uint32_t>((y >> (tile_shift_ - 2)) - first_y_);
    if (column >= tiles_x_ || row >= tiles_y_) return nullptr;
    const std::uint16_t number = tile_at_[column * tiles_y_ + row];
    return number == kNone ? nullptr : &tiles_[number];
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
      if (!is_whole(tile, block)) continue;
      for (std::uint64_t left = block.mask; left != 0; left &= left - 1) {
        const std::uint32_t number = number_of(block, left & (0 - left));
        const int bit = std::countr_zero(left);
        visit(corner + Eigen::Array3i(bit >> 4, bit >> 2 & 3, bit & 3), tile.voxels[number], tile);
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
  /// @param tile_shift  as of `CellBlocks`.
  explicit CellBlockTable(int tile_shift) : tile_shift_(tile_shift) {}
  /// Of all occupied cells.
  CellBlockTable(std::span<const CellBlocks::Place> places, int tile_shift);

  /// Of the next occupied cell. @param place  after those before, not negative; fewer than 2^32 - 1
  /// in all.
  void add(const CellBlocks::Place& place);
  /// Once, after the last cell.
  void finish();

  /// By x, then y.
  [[nodiscard]] std::span<const CellBlocks::Tile> tiles() const { return tiles_; }
  /// Those of one tile stand together, in the order of the tiles.
  [[nodiscard]] std::span<const CellBlocks::Slot> slots() const { return slots_; }

 private:
  struct Block {
    /// Where its tile lies: x, then y.
    std::uint32_t tile;
    CellBlocks::Slot slot;
  };
  int tile_shift_;
  /// Of the last cell.
  std::uint64_t last_block_ = 0;
  std::uint32_t cells_ = 0;
  /// Until they are finished.
  std::vector<Block> blocks_;
  std::vector<CellBlocks::Tile> tiles_;
  std::vector<CellBlocks::Slot> slots_;
};

}  // namespace stillmap::localization
