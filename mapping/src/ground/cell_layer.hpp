#pragma once

#include "ground/cell_points.hpp"
#include "ground/cell_prediction.hpp"
#include "ground/height_grid.hpp"

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// Finds the ground among the points of a cell.
///
/// Columns of a cell in which something stands (points 0.35 to 3 m over the prediction) tell
/// nothing about its ground: their lowest points are those of a wall, a tyre or a bumper.
class CellLayerFinder {
 public:
  /// @param prediction  of the cell's ground.
  /// @param tolerance_m how far the ground may be off it.
  /// @return the mean height of the lowest layer near the prediction, with its slope.
  [[nodiscard]] std::optional<HeightGrid::Node> find(std::span<const CellPoint> points, int cell,
                                                     const CellPrediction& prediction,
                                                     double tolerance_m);

 private:
  std::vector<float> above_;
  std::vector<std::uint8_t> column_;
};

}  // namespace stillmap::mapping
