#include "cell_blocks.hpp"

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <utility>

namespace stillmap::localization {
namespace {

void insert(std::span<CellBlocks::Slot> slots, std::uint32_t shift, const CellBlocks::Slot& block) {
  std::size_t slot = CellBlocks::mixed(block.key) >> shift;
  while (slots[slot].mask != 0) slot = (slot + 1) & (slots.size() - 1);
  slots[slot] = block;
}

}  // namespace

CellBlocks::CellBlocks(std::span<const Part> parts, int tile_shift, float edge_m)
    : tile_shift_(tile_shift), block_mask_((1U << (tile_shift - 2)) - 1) {
  constexpr std::int32_t kMost = std::numeric_limits<std::int32_t>::max();
  Eigen::Array2i low = Eigen::Array2i::Constant(kMost);
  Eigen::Array2i high = Eigen::Array2i::Constant(-kMost);
  std::vector<Eigen::Array2i> at;
  for (const Part& part : parts) {
    voxel_count_ += part.voxels.size();
    for (const Tile& tile : part.tiles) {
      at.emplace_back(tile.x + (part.first_cell.x() >> tile_shift),
                      tile.y + (part.first_cell.y() >> tile_shift));
      low = low.min(at.back());
      high = high.max(at.back());
      tiles_.push_back({.slots = part.slots.data() + tile.first_slot,
                        .voxels = part.voxels.data(),
                        .corner = edge_m * part.first_cell.cast<float>().matrix(),
                        .first_z = part.first_cell.z(),
                        .last_slot = tile.slots - 1,
                        .shift = tile.shift,
                        .voxel_count = static_cast<std::uint32_t>(part.voxels.size())});
    }
  }
  if (tiles_.empty()) return;
  if (tiles_.size() >= kNone) throw std::length_error("CellBlocks: too many tiles");
  first_x_ = low.x();
  first_y_ = low.y();
  tiles_x_ = static_cast<std::uint32_t>(high.x() - low.x()) + 1;
  tiles_y_ = static_cast<std::uint32_t>(high.y() - low.y()) + 1;
  tile_at_.assign(std::size_t{tiles_x_} * tiles_y_, kNone);
  for (std::size_t i = 0; i < at.size(); ++i) {
    const Eigen::Array2i place = at[i] - low;
    tile_at_[static_cast<std::size_t>(place.x()) * tiles_y_ + static_cast<std::size_t>(place.y())] =
        static_cast<std::uint16_t>(i);
  }
}

CellBlockTable::CellBlockTable(std::span<const CellBlocks::Place> places, int tile_shift)
    : tile_shift_(tile_shift) {
  for (const CellBlocks::Place& place : places) add(place);
  finish();
}

void CellBlockTable::add(const CellBlocks::Place& place) {
  if (blocks_.empty() || place.block != last_block_) {
    last_block_ = place.block;
    const int shift = tile_shift_ - 2;
    const std::uint32_t mask = (1U << shift) - 1;
    const auto cell = cell_of_key(place.block);
    const auto x = static_cast<std::uint32_t>(cell[0]);
    const auto y = static_cast<std::uint32_t>(cell[1]);
    const std::uint32_t key =
        CellBlocks::key_in_tile(x & mask, y & mask, static_cast<std::uint32_t>(cell[2]));
    blocks_.push_back({(x >> shift) << 16 | y >> shift, {key, cells_, 0}});
  }
  blocks_.back().slot.mask |= std::uint64_t{1} << place.bit;
  ++cells_;
}

void CellBlockTable::finish() {
  constexpr std::size_t kLeastSlots = 4;  // a cache line
  std::vector<Block> blocks = std::exchange(blocks_, {});
  std::stable_sort(blocks.begin(), blocks.end(),
                   [](const Block& a, const Block& b) { return a.tile < b.tile; });
  for (auto first = blocks.begin(); first != blocks.end();) {
    const auto last =
        std::find_if(first, blocks.end(), [&](const Block& b) { return b.tile != first->tile; });
    // At most half full, so that a look-up touches one cache line most of the time.
    const std::size_t count =
        std::max(kLeastSlots, std::bit_ceil(2 * static_cast<std::size_t>(last - first)));
    const std::uint32_t shift = CellBlocks::shift_of(count);
    tiles_.push_back(
        {static_cast<std::uint16_t>(first->tile >> 16), static_cast<std::uint16_t>(first->tile),
         static_cast<std::uint32_t>(slots_.size()), static_cast<std::uint32_t>(count), shift});
    slots_.resize(slots_.size() + count);
    const std::span<CellBlocks::Slot> own = std::span(slots_).last(count);
    for (; first != last; ++first) insert(own, shift, first->slot);
  }
}

}  // namespace stillmap::localization
