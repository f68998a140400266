#pragma once

#include "index_grid.hpp"
#include "voxel.hpp"

#include <Eigen/Core>

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace stillmap::localization {

/// Columns of a region, in square tiles; those of one tile lie together.
struct RegionColumns {
  /// Binary logarithm of a tile's side.
  static constexpr int kShift = 5;
  static constexpr std::size_t kColumnsOfTile = std::size_t{1} << (2 * kShift);

  [[nodiscard]] static std::int32_t columns(float edge_m) {
    return cells_of_region(static_cast<double>(edge_m));
  }
  /// Tiles along one axis.
  [[nodiscard]] static std::uint32_t tiles(float edge_m) {
    return static_cast<std::uint32_t>(columns(edge_m)) >> kShift;
  }
  [[nodiscard]] static std::uint32_t place_in_tile(std::uint32_t x, std::uint32_t y) {
    constexpr std::uint32_t kLast = (1U << kShift) - 1U;
    return ((y & kLast) << kShift) | (x & kLast);
  }
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

/// Which cells of a region and the eight around it hold anything: a 64-bit word a column, a bit a
/// metre of height. Heights count modulo 64 m, so that hills need no more; what lies 64 m higher in
/// one column counts as the same. A view into mapped files or memory.
class CellBits {
 public:
  struct Part {
    /// For each tile of the region, by y, then x, where its words begin.
    std::span<const std::uint32_t> tiles;
    /// Of all tiles; each tile's lie inside.
    std::span<const std::uint64_t> words;
    /// Of the region among the nine, in [0, 2].
    std::uint32_t x = 0, y = 0;
  };

  /// @param edge_m  of a column. @param parts  the bytes that they look into outlive this.
  CellBits(float edge_m, std::span<const Part> parts);

  [[nodiscard]] float edge_m() const { return edge_m_; }
  /// Of the column at a place, a bit a metre of height. @param x, y  as the points of `hits` [m].
  [[nodiscard]] std::uint64_t column(float x, float y) const;
  /// How many of the points, shifted, have something within a metre of their height [m, relative to
  /// the corner of the region in the middle].
  [[nodiscard]] unsigned hits(const PointColumns& points, const Eigen::Vector3f& shift) const;

  [[nodiscard]] static std::uint32_t height_bit(float z) {
    // A multiple of 64 that keeps heights positive.
    constexpr float kBelow = 64.0F * 1024.0F;
    return static_cast<std::uint32_t>(static_cast<std::int32_t>(z + kBelow));
  }

 private:
  float edge_m_;
  std::uint32_t tiles_along_;
  /// Words of each tile; of an empty one, zeros.
  std::vector<const std::uint64_t*> tiles_;
};

/// What `CellBits` looks into for one region, made from voxels.
class CellBitsTable {
 public:
  explicit CellBitsTable(float edge_m);

  /// @param voxel  of a cell about 1 m wide, of the region.
  void add(const Voxel& voxel);
  [[nodiscard]] std::span<const std::uint32_t> tiles() const { return tiles_; }
  /// The first tile is empty, and stands for all that are.
  [[nodiscard]] std::span<const std::uint64_t> words() const { return words_; }

 private:
  [[nodiscard]] std::uint64_t& word_at(std::uint32_t x, std::uint32_t y);

  float edge_m_;
  std::uint32_t tiles_along_;
  std::vector<std::uint32_t> tiles_;
  std::vector<std::uint64_t> words_;
};

/// Edges of the grids that `PlaceSearch` looks at, from wide to fine [m]. Tiles of 32 columns
/// divide a region.
inline constexpr std::array<float, 2> kPlaceGridEdgesM = {2.0F, 1.0F};
/// Cells of the level that they are made of [m].
inline constexpr double kPlaceCellM = 1.0;

}  // namespace stillmap::localization
