#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <vector>

#include "voxel_table.hpp"

namespace stillmap::localization {

/// Numbers of occupied cells, by blocks of 4 x 4 x 4: the eight cells around a point lie in two
/// blocks on average, so that they cost two look-ups, not eight. Cells are numbered in the order of
/// their blocks' keys, and within a block of their bits.
class CellBlocks {
 public:
  static constexpr std::uint32_t kNone = VoxelTable::kNone;

  /// What cells are numbered by: first the block, then the bit in it.
  struct Place {
    std::uint64_t block = 0;
    std::uint32_t bit = 0;
    auto operator<=>(const Place&) const = default;
  };
  [[nodiscard]] static Place place_of(std::int32_t x, std::int32_t y, std::int32_t z) {
    return {cell_key(x >> 2, y >> 2, z >> 2),
            static_cast<std::uint32_t>(((x & 3) << 4) | ((y & 3) << 2) | (z & 3))};
  }

  CellBlocks() = default;
  /// @param places  of all occupied cells, ascending, each once.
  explicit CellBlocks(const std::vector<Place>& places) : table_(places.size() / 4) {
    for (std::uint32_t i = 0; i < places.size(); ++i) {
      if (table_.insert(places[i].block).second) blocks_.push_back({0, i});
      blocks_.back().mask |= std::uint64_t{1} << places[i].bit;
    }
  }

  /// Number of the cell, `kNone` when it is empty; coordinates must be those of a cell.
  [[nodiscard]] std::uint32_t find(std::int32_t x, std::int32_t y, std::int32_t z) const {
    const Place place = place_of(x, y, z);
    const std::uint32_t block = table_.find(place.block);
    return block == VoxelTable::kNone ? kNone : number(blocks_[block], place.bit);
  }

  /// Calls `visit(number)` for every occupied one of the cells (x, y, z) to (x + 1, y + 1, z + 1),
  /// x slowest.
  template <typename Visit>
  void for_eight(std::int32_t x, std::int32_t y, std::int32_t z, const Visit& visit) const {
    // Blocks by whether the upper neighbour on an axis lies in the next one.
    std::array<const Block*, 8> known{};
    std::array<bool, 8> looked{};
    for (std::int32_t corner = 0; corner < 8; ++corner) {
      const std::int32_t cx = x + (corner >> 2);
      const std::int32_t cy = y + ((corner >> 1) & 1);
      const std::int32_t cz = z + (corner & 1);
      if (!is_cell(cx, cy, cz)) continue;
      const auto which = static_cast<std::size_t>(((cx >> 2) != (x >> 2) ? 4 : 0) |
                                                  ((cy >> 2) != (y >> 2) ? 2 : 0) |
                                                  ((cz >> 2) != (z >> 2) ? 1 : 0));
      const Place place = place_of(cx, cy, cz);
      if (!looked[which]) {
        looked[which] = true;
        const std::uint32_t block = table_.find(place.block);
        known[which] = block == VoxelTable::kNone ? nullptr : &blocks_[block];
      }
      if (known[which] == nullptr) continue;
      const std::uint32_t found = number(*known[which], place.bit);
      if (found != kNone) visit(found);
    }
  }

 private:
  struct Block {
    std::uint64_t mask = 0;
    /// Number of its first cell.
    std::uint32_t first = 0;
  };
  [[nodiscard]] static std::uint32_t number(const Block& block, std::uint32_t bit) {
    const std::uint64_t here = std::uint64_t{1} << bit;
    if ((block.mask & here) == 0) return kNone;
    return block.first + static_cast<std::uint32_t>(std::popcount(block.mask & (here - 1)));
  }

  VoxelTable table_;
  std::vector<Block> blocks_;
};

}  // namespace stillmap::localization
