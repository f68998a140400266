#pragma once

#include "map_level.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace stillmap::localization {

/// Columns of a grid over a map, in square tiles; those of one tile lie together.
struct TiledColumns {
  /// Binary logarithm of a tile's side.
  static constexpr int kShift = 5;
  static constexpr std::size_t kColumnsOfTile = std::size_t{1} << (2 * kShift);

  /// @param extent  of the index [m]. @param edge_m  of a column.
  TiledColumns(const Eigen::Vector3d& extent, float edge_m);

  [[nodiscard]] std::uint32_t tile(std::uint32_t x, std::uint32_t y) const {
    return (y >> kShift) * tiles_x + (x >> kShift);
  }
  [[nodiscard]] static std::uint32_t place_in_tile(std::uint32_t x, std::uint32_t y) {
    constexpr std::uint32_t kLast = (1U << kShift) - 1U;
    return ((y & kLast) << kShift) | (x & kLast);
  }
  [[nodiscard]] std::size_t tiles() const {
    return static_cast<std::size_t>(tiles_x) * static_cast<std::size_t>(tiles_y);
  }

  std::int32_t columns = 0;
  std::int32_t rows = 0;
  std::uint32_t tiles_x = 0;
  std::uint32_t tiles_y = 0;
};

/// Points by coordinate, so that the compiler can take several at once.
struct PointColumns {
  explicit PointColumns(std::size_t count) : x(count), y(count), z(count) {}
  void set(std::size_t i, const Eigen::Vector3f& p) {
    x[i] = p.x();
    y[i] = p.y();
    z[i] = p.z();
  }
  std::vector<float> x, y, z;
};

/// Which cells of a map hold anything: a 64-bit word a column, a bit a metre of height. Heights
/// count modulo 64 m, so that hills need no more; what lies 64 m higher in one column counts as the
/// same. A view into `CellBitsTable` or a mapped file.
class CellBits {
 public:
  /// @param edge_m  of a column. @param extent  of the index [m].
  /// @param tiles   for each tile of `TiledColumns` where its words begin.
  /// @param words   of all tiles; each tile's lie inside.
  CellBits(float edge_m, const Eigen::Vector3d& extent, std::span<const std::uint32_t> tiles,
           std::span<const std::uint64_t> words)
      : edge_m_(edge_m),
        inverse_edge_(1.0F / edge_m),
        grid_(extent, edge_m),
        tiles_(tiles.data()),
        words_(words.data()) {}

  [[nodiscard]] float edge_m() const { return edge_m_; }
  /// How many of the points, shifted, have something within a metre of their height [m, relative to
  /// the index's origin].
  [[nodiscard]] unsigned hits(const PointColumns& points, const Eigen::Vector3f& shift) const;

  [[nodiscard]] static std::uint32_t height_bit(float z) {
    // A multiple of 64 that keeps heights positive.
    constexpr float kBelow = 64.0F * 1024.0F;
    return static_cast<std::uint32_t>(static_cast<std::int32_t>(z + kBelow));
  }

 private:
  float edge_m_;
  float inverse_edge_;
  TiledColumns grid_;
  const std::uint32_t* tiles_;
  const std::uint64_t* words_;
};

/// What `CellBits` looks into, made from voxels.
class CellBitsTable {
 public:
  /// @param voxels  of cells about 1 m wide. @param spread  columns around, to each side, whose
  /// bits are taken over too.
  CellBitsTable(std::span<const Voxel> voxels, const Eigen::Vector3d& extent, float edge_m,
                int spread);

  [[nodiscard]] std::span<const std::uint32_t> tiles() const { return tiles_; }
  /// The first tile is empty, and stands for all that are.
  [[nodiscard]] std::span<const std::uint64_t> words() const { return words_; }

 private:
  [[nodiscard]] std::uint64_t& word_at(std::uint32_t x, std::uint32_t y);

  TiledColumns grid_;
  std::vector<std::uint32_t> tiles_;
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
/// Tiles that the finest grid may have: a rectangle of 17,000 km^2 around all points of a map.
inline constexpr std::size_t kMostGridTiles = std::size_t{1} << 24;

}  // namespace stillmap::localization
