#include "cell_blocks.hpp"

#include <algorithm>
#include <utility>

namespace stillmap::localization {
namespace {

struct TiledBlock {
  std::uint32_t tile = 0;
  CellBlocks::Slot slot;
};

/// Blocks with their cells, in the order of their tiles.
std::vector<TiledBlock> blocks_by_tile(std::span<const CellBlocks::Place> places) {
  std::vector<TiledBlock> blocks;
  for (std::uint32_t i = 0; i < places.size(); ++i) {
    if (i == 0 || places[i].block != places[i - 1].block) {
      const auto [x, y, z] = cell_of_key(places[i].block);
      blocks.push_back({CellBlocks::tile_number(x << 2, y << 2),
                        {CellBlocks::key_in_tile(x << 2, y << 2, z << 2), i, 0}});
    }
    blocks.back().slot.mask |= std::uint64_t{1} << places[i].bit;
  }
  std::stable_sort(blocks.begin(), blocks.end(),
                   [](const TiledBlock& a, const TiledBlock& b) { return a.tile < b.tile; });
  return blocks;
}

void insert(std::span<CellBlocks::Slot> slots, std::uint32_t shift, const CellBlocks::Slot& block) {
  std::size_t slot = CellBlocks::mixed(block.key) >> shift;
  while (slots[slot].mask != 0) slot = (slot + 1) & (slots.size() - 1);
  slots[slot] = block;
}

}  // namespace

CellBlockTable::CellBlockTable(std::span<const CellBlocks::Place> places)
    : cells_(static_cast<std::uint32_t>(places.size())) {
  constexpr std::size_t kLeastSlots = 4;  // a cache line
  const std::vector<TiledBlock> blocks = blocks_by_tile(places);
  std::vector<CellBlocks::Tile> tiles;
  for (auto first = blocks.begin(); first != blocks.end();) {
    const auto last = std::find_if(first, blocks.end(),
                                   [&](const TiledBlock& b) { return b.tile != first->tile; });
    // At most half full, so that a look-up touches one cache line most of the time.
    const std::size_t count =
        std::max(kLeastSlots, std::bit_ceil(2 * static_cast<std::size_t>(last - first)));
    const std::uint32_t shift = CellBlocks::shift_of(count);
    tiles.push_back({first->tile, static_cast<std::uint32_t>(slots_.size()),
                     static_cast<std::uint32_t>(count), shift});
    slots_.resize(slots_.size() + count);
    const std::span<CellBlocks::Slot> own = std::span(slots_).last(count);
    for (; first != last; ++first) insert(own, shift, first->slot);
  }
  tiles_.resize(std::bit_ceil(2 * tiles.size() + 4));
  for (const CellBlocks::Tile& tile : tiles) {
    std::size_t at = CellBlocks::mixed(tile.number) >> CellBlocks::shift_of(tiles_.size());
    while (tiles_[at].slots != 0) at = (at + 1) & (tiles_.size() - 1);
    tiles_[at] = tile;
  }
}

}  // namespace stillmap::localization
