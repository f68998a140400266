#include "cell_bits.hpp"

#include <algorithm>
#include <bit>
#include <utility>

namespace stillmap::localization {
namespace {

std::int32_t cells_along(double extent_m, float edge_m) {
  return static_cast<std::int32_t>(static_cast<float>(extent_m) / edge_m) + 1;
}

}  // namespace

CellBits::CellBits(float edge_m, const Eigen::Vector3d& extent, std::span<const Tile> tiles,
                   std::span<const std::uint64_t> words)
    : edge_m_(edge_m),
      inverse_edge_(1.0F / edge_m),
      columns_(cells_along(extent.x(), edge_m)),
      rows_(cells_along(extent.y(), edge_m)),
      shift_(shift_of(tiles.size())),
      tiles_(tiles),
      words_(words) {}

CellBitsTable::CellBitsTable(std::span<const Voxel> voxels, const Eigen::Vector3d& extent,
                             float edge_m, int spread)
    : tiles_(4) {
  const float inverse_edge = 1.0F / edge_m;
  const std::int32_t columns = cells_along(extent.x(), edge_m);
  const std::int32_t rows = cells_along(extent.y(), edge_m);
  for (const Voxel& voxel : voxels) {
    const auto x = static_cast<std::int32_t>(voxel.mean.x() * inverse_edge);
    const auto y = static_cast<std::int32_t>(voxel.mean.y() * inverse_edge);
    const std::uint64_t bit = std::uint64_t{1} << (CellBits::height_bit(voxel.mean.z()) % 64U);
    const std::uint64_t bits = bit | std::rotl(bit, 1) | std::rotr(bit, 1);
    for (std::int32_t row = std::max(0, y - spread); row <= std::min(rows - 1, y + spread); ++row) {
      for (std::int32_t column = std::max(0, x - spread);
           column <= std::min(columns - 1, x + spread); ++column) {
        word_at(column, row) |= bits;
      }
    }
  }
}

std::uint64_t& CellBitsTable::word_at(std::int32_t x, std::int32_t y) {
  const std::uint64_t number = CellBits::tile_number(x, y);
  const auto find = [&] {
    std::size_t at = CellBits::slot_of(number, CellBits::shift_of(tiles_.size()));
    while (tiles_[at].place != 0 && tiles_[at].number != number) at = (at + 1) % tiles_.size();
    return at;
  };
  std::size_t at = find();
  if (tiles_[at].place == 0) {
    const std::size_t known = words_.size() / CellBits::kWordsOfTile;
    // At most a quarter full: nearly every look-up ends at its first entry.
    if (4 * (known + 1) > tiles_.size()) {
      rehash(2 * tiles_.size());
      at = find();
    }
    words_.resize(words_.size() + CellBits::kWordsOfTile);
    tiles_[at] = {number, static_cast<std::uint32_t>(known + 1), 0};
  }
  return words_[(tiles_[at].place - 1) * CellBits::kWordsOfTile + CellBits::place_in_tile(x, y)];
}

void CellBitsTable::rehash(std::size_t size) {
  const std::vector<CellBits::Tile> old = std::exchange(tiles_, std::vector<CellBits::Tile>(size));
  for (const CellBits::Tile& tile : old) {
    if (tile.place == 0) continue;
    std::size_t at = CellBits::slot_of(tile.number, CellBits::shift_of(size));
    while (tiles_[at].place != 0) at = (at + 1) % size;
    tiles_[at] = tile;
  }
}

}  // namespace stillmap::localization
