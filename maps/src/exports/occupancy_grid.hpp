#pragma once

#include <Eigen/Core>

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "exports/ground_heights.hpp"

namespace stillmap::maps {

enum class Cell : std::uint8_t { kUnknown, kFree, kOccupied };

/// A map seen from above: what stands in a band of heights above the ground, and where a way is
/// known to be free. What is known stays so: points come before rays, and what stands wins.
class OccupancyGrid {
 public:
  /// @param min,max  what it covers [m].  @param ground  outlives this.
  OccupancyGrid(const Eigen::Vector2d& min, const Eigen::Vector2d& max, double resolution_m,
                const std::array<double, 2>& height_band_m, const GroundHeights& ground);

  /// Cells of such a grid.
  [[nodiscard]] static double cells(const Eigen::Vector2d& min, const Eigen::Vector2d& max,
                                    double resolution_m);

  /// A point in the band occupies its cell; ground frees it.
  void add_point(const Eigen::Vector3d& p, bool is_ground);
  /// What a ray passes in the band before its last cell is free. Rays of more than 500 m are
  /// left out.
  void add_ray(const Eigen::Vector3d& from, const Eigen::Vector3d& to);

  /// Lower left corner of the first cell [m].
  [[nodiscard]] const Eigen::Vector2d& min() const { return min_; }
  [[nodiscard]] std::size_t width() const { return width_; }
  [[nodiscard]] std::size_t height() const { return height_; }
  /// @param x,y  column and row, from the lower left.
  [[nodiscard]] Cell at(std::size_t x, std::size_t y) const { return cells_[y * width_ + x]; }

 private:
  /// Nothing outside.
  Cell* find(double x, double y);
  double resolution_m_;
  std::array<double, 2> band_m_;
  const GroundHeights* ground_;
  Eigen::Vector2d min_;
  std::size_t width_, height_;
  std::vector<Cell> cells_;
};

}  // namespace stillmap::maps
