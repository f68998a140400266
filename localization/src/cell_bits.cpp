#include "cell_bits.hpp"

#include <algorithm>
#include <bit>

namespace stillmap::localization {
namespace {

std::int32_t cells_along(double extent_m, float edge_m) {
  return static_cast<std::int32_t>(static_cast<float>(extent_m) / edge_m) + 1;
}

}  // namespace

TiledColumns::TiledColumns(const Eigen::Vector3d& extent, float edge_m)
    : columns(cells_along(extent.x(), edge_m)),
      rows(cells_along(extent.y(), edge_m)),
      tiles_x(((columns - 1) >> kShift) + 1),
      tiles_y(((rows - 1) >> kShift) + 1) {}

CellBitsTable::CellBitsTable(std::span<const Voxel> voxels, const Eigen::Vector3d& extent,
                             float edge_m, int spread)
    : grid_(extent, edge_m), tiles_(grid_.tiles()), words_(TiledColumns::kColumnsOfTile) {
  const float inverse_edge = 1.0F / edge_m;
  for (const Voxel& voxel : voxels) {
    const auto x = static_cast<std::int32_t>(voxel.mean.x() * inverse_edge);
    const auto y = static_cast<std::int32_t>(voxel.mean.y() * inverse_edge);
    const std::uint64_t bit = std::uint64_t{1} << (CellBits::height_bit(voxel.mean.z()) % 64U);
    const std::uint64_t bits = bit | std::rotl(bit, 1) | std::rotr(bit, 1);
    for (std::int32_t row = std::max(0, y - spread); row <= std::min(grid_.rows - 1, y + spread);
         ++row) {
      for (std::int32_t column = std::max(0, x - spread);
           column <= std::min(grid_.columns - 1, x + spread); ++column) {
        word_at(column, row) |= bits;
      }
    }
  }
}

std::uint64_t& CellBitsTable::word_at(std::int32_t x, std::int32_t y) {
  std::uint32_t& tile = tiles_[grid_.tile(x, y)];
  if (tile == 0) {
    tile = static_cast<std::uint32_t>(words_.size() / TiledColumns::kColumnsOfTile);
    words_.resize(words_.size() + TiledColumns::kColumnsOfTile);
  }
  return words_[tile * TiledColumns::kColumnsOfTile + TiledColumns::place_in_tile(x, y)];
}

}  // namespace stillmap::localization
