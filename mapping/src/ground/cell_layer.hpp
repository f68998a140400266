#pragma once

#include "ground/cell_points.hpp"
#include "ground/cell_prediction.hpp"
#include "ground/height_grid.hpp"

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// A thing that stands is seen between these heights over the ground [m]; the bodies of cars reach
/// below the lower one, ceilings and crowns begin above the higher one.
inline constexpr float kStandingFromM = 0.35F;
inline constexpr float kStandingToM = 2.0F;

/// Finds the ground among the points of a cell.
///
/// A quarter of the cell in which something stands says nothing about its ground: the lowest points
/// there are those of a wall, a tyre or a bumper. Where no neighbouring cell has ground, one thing
/// that stands spoils the whole cell, since sparse beams and slanted sides leave quarters that only
/// look free.
class CellLayerFinder {
 public:
  /// @param prediction   of the cell's ground.
  /// @param tolerance_m  how far the ground may be off it.
  /// @return the plane of the lowest layer of points near the prediction, drawn to its slope.
  [[nodiscard]] std::optional<HeightGrid::Node> find(std::span<const CellPoint> points, int cell,
                                                     const CellPrediction& prediction,
                                                     double tolerance_m);

 private:
  struct NearPoint {
    /// From the cell's centre, and above the prediction [m].
    float x, y, above;
    std::uint8_t quarter;
  };
  void collect(std::span<const CellPoint> points, int cell, const CellPrediction& prediction,
               float tolerance_m);
  void drop_standing_quarters();
  [[nodiscard]] std::optional<float> lowest(float tolerance_m) const;

  std::vector<NearPoint> near_;
  std::array<bool, 4> stands_{};
};

}  // namespace stillmap::mapping
