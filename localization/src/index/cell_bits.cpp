#include "cell_bits.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>

// Compiled once for each instruction set, with as many points at once as it allows; the best one is
// chosen when the program runs.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "index/cell_bits.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace stillmap::localization::HWY_NAMESPACE {

/// See `CellBits::hits`. @param tiles  words of each tile.
unsigned count_hits(const std::uint64_t* const* tiles, std::uint32_t tiles_along, float edge_m,
                    const PointColumns& points, const Eigen::Vector3f& shift) {
  // First all arithmetic, several points at once, then the look-ups.
  constexpr std::size_t kAtOnce = 64;
  std::array<std::uint32_t, kAtOnce> tile, place, bit, inside;
  const float inverse_edge = 1.0F / edge_m;
  const std::uint32_t columns = tiles_along << RegionColumns::kShift;
  const float sx = shift.x() + static_cast<float>(kRegionM);
  const float sy = shift.y() + static_cast<float>(kRegionM);
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
      const auto column = static_cast<std::uint32_t>(static_cast<std::int32_t>(px * inverse_edge));
      const auto row = static_cast<std::uint32_t>(static_cast<std::int32_t>(py * inverse_edge));
      // By sign bits, for comparisons would keep the compiler from taking several points at once.
      // Negative coordinates round towards zero, onto the first column; there is nothing beside it.
      const std::uint32_t outside = std::bit_cast<std::uint32_t>(px) |
                                    std::bit_cast<std::uint32_t>(py) | column | row |
                                    ~(column - columns) | ~(row - columns);
      inside[i] = ~outside >> 31;
      tile[i] = ((row >> RegionColumns::kShift) * tiles_along + (column >> RegionColumns::kShift)) &
                (0U - inside[i]);
      place[i] = RegionColumns::place_in_tile(column, row);
      bit[i] = CellBits::height_bit(z[i] + sz) % 64U;
    }
    for (std::size_t i = 0; i < n; ++i) {
      count += static_cast<unsigned>(tiles[tile[i]][place[i]] >> bit[i]) & inside[i];
    }
  }
  return count;
}

}  // namespace stillmap::localization::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace stillmap::localization {
namespace {

/// Regions along one axis.
constexpr std::uint32_t kRegionsAlong = 3;
constexpr std::array<std::uint64_t, RegionColumns::kColumnsOfTile> kEmptyTile{};

}  // namespace

CellBits::CellBits(float edge_m, std::span<const Part> parts)
    : edge_m_(edge_m),
      tiles_along_(kRegionsAlong * RegionColumns::tiles(edge_m)),
      tiles_(std::size_t{tiles_along_} * tiles_along_, kEmptyTile.data()) {
  const std::uint32_t side = RegionColumns::tiles(edge_m);
  for (const Part& part : parts) {
    for (std::uint32_t tile = 0; tile < part.tiles.size(); ++tile) {
      const std::uint32_t x = part.x * side + tile % side;
      const std::uint32_t y = part.y * side + tile / side;
      tiles_[std::size_t{y} * tiles_along_ + x] = part.words.data() + part.tiles[tile];
    }
  }
}

std::uint64_t CellBits::column(float x, float y) const {
  const float from_west = (x + static_cast<float>(kRegionM)) / edge_m_;
  const float from_south = (y + static_cast<float>(kRegionM)) / edge_m_;
  const auto columns = static_cast<float>(tiles_along_ << RegionColumns::kShift);
  if (!(from_west >= 0.0F && from_west < columns && from_south >= 0.0F && from_south < columns))
    return 0;
  const auto column = static_cast<std::uint32_t>(from_west);
  const auto row = static_cast<std::uint32_t>(from_south);
  const std::size_t tile =
      (row >> RegionColumns::kShift) * tiles_along_ + (column >> RegionColumns::kShift);
  return tiles_[tile][RegionColumns::place_in_tile(column, row)];
}

HWY_EXPORT(count_hits);

unsigned CellBits::hits(const PointColumns& points, const Eigen::Vector3f& shift) const {
  return HWY_DYNAMIC_DISPATCH(count_hits)(tiles_.data(), tiles_along_, edge_m_, points, shift);
}

CellBitsTable::CellBitsTable(float edge_m)
    : edge_m_(edge_m),
      tiles_along_(RegionColumns::tiles(edge_m)),
      tiles_(std::size_t{tiles_along_} * tiles_along_),
      words_(RegionColumns::kColumnsOfTile) {}

void CellBitsTable::add(const Voxel& voxel) {
  const std::int32_t last = RegionColumns::columns(edge_m_) - 1;
  const auto x = static_cast<std::int32_t>(std::floor(voxel.mean.x() / edge_m_));
  const auto y = static_cast<std::int32_t>(std::floor(voxel.mean.y() / edge_m_));
  const std::uint64_t bit = std::uint64_t{1} << (CellBits::height_bit(voxel.mean.z()) % 64U);
  if (x < 0 || x > last || y < 0 || y > last) return;
  word_at(static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(y)) |=
      bit | std::rotl(bit, 1) | std::rotr(bit, 1);
}

std::uint64_t& CellBitsTable::word_at(std::uint32_t x, std::uint32_t y) {
  constexpr int kShift = RegionColumns::kShift;
  std::uint32_t& first = tiles_[std::size_t{y >> kShift} * tiles_along_ + (x >> kShift)];
  if (first == 0) {
    first = static_cast<std::uint32_t>(words_.size());
    words_.resize(words_.size() + RegionColumns::kColumnsOfTile);
  }
  return words_[first + RegionColumns::place_in_tile(x, y)];
}

}  // namespace stillmap::localization
#endif  // HWY_ONCE
