#pragma once

#include "ground/seed_plane.hpp"

#include <stillmap/mapping/ground.hpp>

#include <array>
#include <optional>
#include <vector>

namespace stillmap::mapping {

/// Ground heights on a square grid of 1 m cells around the sensor, each with its slope.
///
/// A height between nodes is the bilinear blend of the planes of the (up to four) known nodes
/// around it, so that a constant slope is met exactly, also where a neighbour is missing.
class HeightGrid final : public GroundSurface {
 public:
  static constexpr int kCellsPerSide = 200;
  static constexpr double kCellM = 1.0;
  static constexpr double kHalfSideM = 0.5 * kCellsPerSide * kCellM;

  /// A cell's plane: z = height + slope . (p - centre of the cell).
  struct Node {
    float z = 0.0F;
    float slope_x = 0.0F;
    float slope_y = 0.0F;
    /// 1 = ground was seen in the cell, 0 = unknown, between = filled in from cells nearby.
    float confidence = 0.0F;
  };

  HeightGrid() : nodes_(static_cast<std::size_t>(kCellsPerSide) * kCellsPerSide) {}

  /// @return -1 outside of the grid; NaN is outside.
  [[nodiscard]] static int index_of(float x, float y);
  [[nodiscard]] static double centre_x(int index) {
    return (index % kCellsPerSide + 0.5) * kCellM - kHalfSideM;
  }
  [[nodiscard]] static double centre_y(int index) {
    return (index / kCellsPerSide + 0.5) * kCellM - kHalfSideM;
  }

  [[nodiscard]] Node& node(int index) { return nodes_[static_cast<std::size_t>(index)]; }
  [[nodiscard]] const Node& node(int index) const {
    return nodes_[static_cast<std::size_t>(index)];
  }

  [[nodiscard]] std::optional<Sample> at(double x, double y) const override;
  [[nodiscard]] std::optional<double> z_at(double x, double y) const override;
  /// The height of `at` in single precision, for a place in a known cell.
  [[nodiscard]] float height_at(float x, float y) const;

  /// Fills unknown nodes up to `reach` cells from known ones, then irons the filled ones.
  void fill(int reach);
  /// Adds a plane to the known heights and slopes.
  void tilt(const SeedPlane& plane);

 private:
  template <typename Add>
  double for_nodes_around(double x, double y, const Add& add) const;
  [[nodiscard]] std::vector<int> unknown_beside(const std::vector<int>& cells) const;
  [[nodiscard]] Node from_neighbours(int cell, float confidence) const;
  void iron(const std::vector<int>& cells);

  std::vector<Node> nodes_;
};

}  // namespace stillmap::mapping
