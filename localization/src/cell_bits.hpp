#pragma once

#include "map_level.hpp"

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace stillmap::localization {

/// Which cells of a map hold anything: a 64-bit word a column, a bit a metre of height. Heights
/// count modulo 64 m, so that hills need no more; what lies 64 m higher in one column counts as the
/// same. A view into `CellBitsTable` or a mapped file; whatever the bytes say, a look-up ends and
/// stays inside the spans.
class CellBits {
 public:
  /// Columns to a side of a tile; those of one lie together, and a tile without anything nowhere.
  static constexpr std::int32_t kSide = 32;
  static constexpr std::size_t kWordsOfTile = std::size_t{kSide} * kSide;
  /// Where the words of a tile are.
  struct Tile {
    /// Row in the upper half, column in the lower.
    std::uint64_t number = 0;
    /// In tiles; 0 marks an empty entry.
    std::uint32_t place = 0;
    std::uint32_t unused = 0;
  };
  static_assert(sizeof(Tile) == 16);

  CellBits() = default;
  /// @param edge_m  of a column. @param extent  of the index [m].
  /// @param tiles   hash table, a power of two above 1 of them, linear probing.
  /// @param words   of all tiles; no tile's place is beyond them.
  CellBits(float edge_m, const Eigen::Vector3d& extent, std::span<const Tile> tiles,
           std::span<const std::uint64_t> words);

  [[nodiscard]] float edge_m() const { return edge_m_; }
  /// 1 where something lies within a metre of this height [m, relative to the index's origin].
  [[nodiscard]] unsigned hit(const Eigen::Vector3f& p) const {
    const auto x = static_cast<std::int32_t>(p.x() * inverse_edge_);
    const auto y = static_cast<std::int32_t>(p.y() * inverse_edge_);
    // Negative coordinates round towards zero, onto the first column; there is nothing beside it.
    if (p.x() < 0.0F || p.y() < 0.0F || x >= columns_ || y >= rows_) return 0;
    return static_cast<unsigned>(word(x, y) >> (height_bit(p.z()) % 64U)) & 1U;
  }

  [[nodiscard]] static std::uint32_t height_bit(float z) {
    return static_cast<std::uint32_t>(static_cast<std::int32_t>(z + kBelow));
  }
  [[nodiscard]] static std::uint64_t tile_number(std::int32_t x, std::int32_t y) {
    return (static_cast<std::uint64_t>(y / kSide) << 32) | static_cast<std::uint64_t>(x / kSide);
  }
  [[nodiscard]] static std::size_t place_in_tile(std::int32_t x, std::int32_t y) {
    return static_cast<std::size_t>(y % kSide * kSide + x % kSide);
  }
  /// Fibonacci hashing: the top bits of the product mix all bits of the number.
  [[nodiscard]] static std::size_t slot_of(std::uint64_t number, std::uint32_t shift) {
    return static_cast<std::size_t>((number * 0x9E3779B97F4A7C15ULL) >> shift);
  }
  /// What leaves of a mixed number a place in a table of so many.
  [[nodiscard]] static std::uint32_t shift_of(std::size_t size) {
    return static_cast<std::uint32_t>(64 - std::countr_zero(size));
  }

 private:
  /// A multiple of 64 that keeps heights positive.
  static constexpr float kBelow = 64.0F * 1024.0F;

  [[nodiscard]] std::uint64_t word(std::int32_t x, std::int32_t y) const {
    const std::uint64_t number = tile_number(x, y);
    std::size_t at = slot_of(number, shift_);
    for (std::size_t tried = 0; tried < tiles_.size();
         ++tried, at = (at + 1) & (tiles_.size() - 1)) {
      const Tile& tile = tiles_[at];
      if (tile.place == 0) return 0;
      if (tile.number != number) continue;
      return words_[(tile.place - 1) * kWordsOfTile + place_in_tile(x, y)];
    }
    return 0;
  }

  float edge_m_ = 1.0F;
  float inverse_edge_ = 1.0F;
  std::int32_t columns_ = 0;
  std::int32_t rows_ = 0;
  std::uint32_t shift_ = 0;
  std::span<const Tile> tiles_;
  std::span<const std::uint64_t> words_;
};

/// What `CellBits` looks into, made from voxels.
class CellBitsTable {
 public:
  /// @param voxels  of cells about 1 m wide. @param spread  columns around, to each side, whose
  /// bits are taken over too.
  CellBitsTable(std::span<const Voxel> voxels, const Eigen::Vector3d& extent, float edge_m,
                int spread);

  [[nodiscard]] std::span<const CellBits::Tile> tiles() const { return tiles_; }
  [[nodiscard]] std::span<const std::uint64_t> words() const { return words_; }

 private:
  [[nodiscard]] std::uint64_t& word_at(std::int32_t x, std::int32_t y);
  void rehash(std::size_t size);

  std::vector<CellBits::Tile> tiles_;
  std::vector<std::uint64_t> words_;
};

/// How the grids that `PlaceSearch` looks at are made, from wide to fine.
struct PlaceGrid {
  float edge_m;
  int spread;
};
inline constexpr std::array<PlaceGrid, 3> kPlaceGrids = {{{2.0F, 1}, {2.0F, 0}, {1.0F, 0}}};
/// Cells of the level that they are made of [m].
inline constexpr double kPlaceCellM = 1.0;

}  // namespace stillmap::localization
