#include "cell_bits.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>

namespace stillmap::localization {
namespace {

std::int32_t cells_along(double extent_m, float edge_m) {
  return static_cast<std::int32_t>(static_cast<float>(extent_m) / edge_m) + 1;
}

}  // namespace

TiledColumns::TiledColumns(const Eigen::Vector3d& extent, float edge_m)
    : columns(cells_along(extent.x(), edge_m)),
      rows(cells_along(extent.y(), edge_m)),
      tiles_x(static_cast<std::uint32_t>((columns - 1) >> kShift) + 1),
      tiles_y(static_cast<std::uint32_t>((rows - 1) >> kShift) + 1) {}

unsigned CellBits::hits(const PointColumns& points, const Eigen::Vector3f& shift) const {
  // First all arithmetic, several points at once, then the look-ups.
  constexpr std::size_t kAtOnce = 64;
  std::array<std::uint32_t, kAtOnce> tile, place, bit, inside;
  const auto columns = static_cast<std::uint32_t>(grid_.columns);
  const auto rows = static_cast<std::uint32_t>(grid_.rows);
  const float sx = shift.x();
  const float sy = shift.y();
  const float sz = shift.z();
  unsigned count = 0;
  for (std::size_t first = 0; first < points.x.size(); first += kAtOnce) {
    const std::size_t n = std::min(kAtOnce, points.x.size() - first);
    const float* x = points.x.data() + first;
    const float* y = points.y.data() + first;
    const float* z = points.z.data() + first;
    for (std::size_t i = 0; i < n; ++i) {
      const float px = x[i] + sx;
      const float py = y[i] + sy;
      const auto column = static_cast<std::uint32_t>(static_cast<std::int32_t>(px * inverse_edge_));
      const auto row = static_cast<std::uint32_t>(static_cast<std::int32_t>(py * inverse_edge_));
      // By sign bits, for comparisons would keep the compiler from taking several points at once.
      // Negative coordinates round towards zero, onto the first column; there is nothing beside it.
      const std::uint32_t outside = std::bit_cast<std::uint32_t>(px) |
                                    std::bit_cast<std::uint32_t>(py) | column | row |
                                    ~(column - columns) | ~(row - rows);
      inside[i] = ~outside >> 31;
      tile[i] = grid_.tile(column, row) & (0U - inside[i]);
      place[i] = TiledColumns::place_in_tile(column, row);
      bit[i] = height_bit(z[i] + sz) % 64U;
    }
    for (std::size_t i = 0; i < n; ++i) {
      count += static_cast<unsigned>(words_[tiles_[tile[i]] + place[i]] >> bit[i]) & inside[i];
    }
  }
  return count;
}

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
        word_at(static_cast<std::uint32_t>(column), static_cast<std::uint32_t>(row)) |= bits;
      }
    }
  }
}

std::uint64_t& CellBitsTable::word_at(std::uint32_t x, std::uint32_t y) {
  std::uint32_t& first = tiles_[grid_.tile(x, y)];
  if (first == 0) {
    first = static_cast<std::uint32_t>(words_.size());
    words_.resize(words_.size() + TiledColumns::kColumnsOfTile);
  }
  return words_[first + TiledColumns::place_in_tile(x, y)];
}

}  // namespace stillmap::localization
