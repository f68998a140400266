#pragma once

#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// The ground of a map without scans: the lowest layer of its columns, as far as it goes on evenly.
///
/// Nothing says from where the points were seen, so neither rays nor rings help, as they do in a
/// scan. The lowest 0.15 m of a column of 0.5 m are its candidate. Candidates that step by no more
/// than 0.2 m from one column to the next (a slope of 0.35 and a kerb are below it, a roof, a car
/// and a reflection under the road are not) belong together, and what belongs together on 50 m^2 or
/// more is ground. Under a bridge that is the lower road alone; a flat roof of that size passes.
class ColumnGround {
 public:
  static constexpr double kCellM = 0.5;
  static constexpr int kCells = 40;  ///< a side of a tile

  /// @param points  of one tile, from the map's origin [m]; each tile once.
  void add(maps::TileId tile, std::span<const Eigen::Vector3f> points);
  /// Ends the adding.
  void finish();

  /// Height of the ground in the column of a point [m]; nothing where there is none.
  [[nodiscard]] std::optional<float> at(const Eigen::Vector3f& p) const;

  /// Where a sensor may stand: in each square of 4 m the column next to its middle that is ground,
  /// with ground all around for 1 m (to a fifth unknown) and nothing from 0.35 to 2 m above it,
  /// where a car would be. Poses 1.8 m above the ground, z its normal, from the map's origin.
  [[nodiscard]] std::vector<Eigen::Isometry3d> places() const;

 private:
  static constexpr int kNothing = -1;
  static constexpr int kNotGround = -2;
  static constexpr int kNotYet = -3;
  struct Column {
    /// Of the lowest layer [m].
    float height_m = 0.0F;
    /// Number of what it belongs to, from 0, or one of the above.
    int part = kNothing;
    /// Whether something stands on it.
    bool taken = false;
  };
  using Tile = std::array<Column, static_cast<std::size_t>(kCells) * kCells>;
  /// Number of a column along x and y, over all tiles.
  struct Cell {
    std::int64_t x, y;
  };
  [[nodiscard]] static Cell cell_of(const Eigen::Vector3f& p);
  [[nodiscard]] static Eigen::Vector2d centre_of(const Cell& cell);
  /// @return nullptr where no tile is.
  [[nodiscard]] Column* find(const Cell& cell);
  [[nodiscard]] const Column* find(const Cell& cell) const;
  /// All that belongs to a column gets its number. @return these.
  std::vector<Column*> part_from(const Cell& seed, int number);
  [[nodiscard]] bool is_free(const Cell& cell) const;
  [[nodiscard]] Eigen::Isometry3d place_at(const Cell& cell) const;

  std::map<maps::TileId, Tile> tiles_;
};

}  // namespace stillmap::mapping
