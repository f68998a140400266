#pragma once

#include "cell_bits.hpp"

#include <Eigen/Geometry>

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <optional>

namespace stillmap::localization {

/// What stands around a place, or around a scan, as bits: is there anything in a sector, at a
/// distance, at a height? Heights begin at the lidar, above the ground, which is everywhere. (Bits
/// of the map reach a metre up: below a lidar lower than some 1.2 m, and uphill, the ground comes
/// in.)
///
/// A scan is compared with a place in a microsecond, in every heading. Shape as Scan Context (Kim,
/// Kim, IROS 2018), with departures: all heights instead of the highest one, and what the map holds
/// behind walls counts for nothing, for only bits that the scan can tell about are compared.
struct PlaceView {
  static constexpr std::size_t kSectors = 40;
  static constexpr std::size_t kRings = 16, kHeights = 4;
  /// Edges of the rings [m].
  static constexpr std::array<float, kRings + 1> kRingEdgesM = {
      2.0F,  4.0F,  6.0F,  8.0F,  10.0F, 12.0F, 14.5F, 17.0F, 20.0F,
      23.0F, 26.5F, 30.0F, 34.0F, 38.0F, 43.0F, 48.0F, 54.0F};
  /// Heights are so high, and count from the lidar's own [m].
  static constexpr float kHeightM = 1.5F;
  static constexpr float kSectorRad = 2.0F * std::numbers::pi_v<float> / kSectors;

  /// Counterclockwise from the x axis; a bit is that of `bit_of`.
  std::array<std::uint64_t, kSectors> sectors{};

  /// Nothing below the lidar and above all heights. @param z  above the lidar [m].
  [[nodiscard]] static std::optional<std::uint64_t> bit_of(std::size_t ring, float z) {
    if (!(z >= 0.0F && z < kHeightM * kHeights)) return std::nullopt;
    return std::uint64_t{1} << (ring * kHeights + static_cast<std::size_t>(z / kHeightM));
  }
  [[nodiscard]] int count() const {
    int bits = 0;
    for (const std::uint64_t sector : sectors) bits += std::popcount(sector);
    return bits;
  }
};
static_assert(sizeof(PlaceView) == 320);

/// @param cells  of 1 m. @param T_cells_place  a place upright above their corner.
[[nodiscard]] PlaceView view_of_place(const CellBits& cells,
                                      const Eigen::Isometry3f& T_cells_place);

/// Bits of two views that agree, for every heading of the first in the second: sector 0 of the one
/// lies on the sector of the heading of the other.
using ViewHits = std::array<std::uint32_t, PlaceView::kSectors>;
void count_view_hits(const PlaceView& turned, const PlaceView& fixed, ViewHits& hits);

}  // namespace stillmap::localization
