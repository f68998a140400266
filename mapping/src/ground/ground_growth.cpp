#include "ground/ground_growth.hpp"

#include "ground/cell_layer.hpp"
#include "ground/cell_prediction.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wfloat-conversion"

namespace stillmap::mapping {
namespace {

/// A kerb and the noise on it [m]; what sticks out more within a cell or two is an object.
constexpr double kStepM = 0.2;
/// Range [m] up to which a cell may start the growth.
constexpr double kStartRangeM = 12.0;
/// How far points may be off a plane that starts it [m].
constexpr double kPlaneM = 0.12;
const double kPA = getenv("PA") ? atof(getenv("PA")) : -1;
const double kPB = getenv("PB") ? atof(getenv("PB")) : 0.0;

class Growth {
 public:
  Growth(const CellPoints& points, const Patches& patches, HeightGrid& grid)
      : layout_(PatchLayout::instance()), points_(points), patches_(patches), grid_(grid) {}

  void run() {
    start();
    // The second round reaches what lies behind obstacles, from the side and from beyond.
    for (int round = 0; round < 2; ++round) grow();
    take_back_outliers();
  }

 private:
  [[nodiscard]] double range_of(int cell) const {
    return static_cast<double>(layout_.range_m[static_cast<std::size_t>(cell)]);
  }

  /// The plane of the cell's patch where that is ground.
  [[nodiscard]] std::optional<CellPrediction> from_patch(int cell) const {
    const int patch = layout_.patch_of_cell[static_cast<std::size_t>(cell)];
    if (patch < 0 || patches_.verdicts[static_cast<std::size_t>(patch)] != PatchVerdict::kGround)
      return std::nullopt;
    const PlaneFit& plane = patches_.planes[static_cast<std::size_t>(patch)];
    const Eigen::Vector2d slope = -plane.normal.head<2>() / plane.normal.z();
    if (slope.norm() > kMaxGroundSlope) return std::nullopt;
    return CellPrediction{plane.height_at(HeightGrid::centre_x(cell), HeightGrid::centre_y(cell)),
                          slope, 1, 0.0};
  }

  void start() {
    for (const int cell : points_.near_to_far()) {
      if (range_of(cell) > kStartRangeM) break;
      const auto patch = from_patch(cell);
      if (patch && std::abs(patch->z) < 0.3 && accept(cell, *patch, kPlaneM)) continue;
      accept(cell, CellPrediction{0.0, Eigen::Vector2d::Zero(), 1, 0.0}, kPlaneM);
    }
  }

  void grow() {
    for (const int cell : points_.near_to_far()) {
      if (grid_.node(cell).confidence > 0.0F) continue;
      CellPrediction prediction = predict_from_neighbours(grid_, cell, range_of(cell));
      if (prediction.supports == 0) prediction = predict_along_ray(grid_, cell, range_of(cell));
      if (prediction.supports == 0) continue;
      if (accept(cell, prediction, std::min(0.4, kStepM + 0.015 * prediction.gap_m))) continue;
      const auto patch = from_patch(cell);
      if (patch && std::abs(patch->z - prediction.z) < kPA + kPB * prediction.gap_m)
        accept(cell, *patch, kPlaneM);
    }
  }

  bool accept(int cell, const CellPrediction& prediction, double tolerance_m) {
    const auto node = finder_.find(points_.of_cell(cell), cell, prediction, tolerance_m);
    if (node) grid_.node(cell) = *node;
    return node.has_value();
  }

  void take_back_outliers() {
    std::vector<std::pair<int, HeightGrid::Node>> checked;
    static const bool keep = getenv("KEEPSLOPE");
    for (const int cell : points_.near_to_far()) {
      const HeightGrid::Node& n = grid_.node(cell);
      if (n.confidence <= 0.0F) continue;
      const CellPrediction prediction = predict_from_neighbours(grid_, cell, range_of(cell));
      HeightGrid::Node after = n;
      if (!keep) {
      after.slope_x = static_cast<float>(prediction.slope.x());
      after.slope_y = static_cast<float>(prediction.slope.y());
      }
      const double tolerance_m =
          kStepM + 0.01 * range_of(cell) * (prediction.supports < 4 ? 1.0 : 0.2);
      const bool lonely = prediction.supports == 0;
      if (!lonely && std::abs(static_cast<double>(n.z) - prediction.z) > tolerance_m) after = HeightGrid::Node{};
      if (!lonely) checked.emplace_back(cell, after);
    }
    for (const auto& [cell, after] : checked) grid_.node(cell) = after;
  }

  const PatchLayout& layout_;
  const CellPoints& points_;
  const Patches& patches_;
  HeightGrid& grid_;
  CellLayerFinder finder_;
};

}  // namespace

void grow_ground(const CellPoints& points, const Patches& patches, HeightGrid& grid) {
  Growth(points, patches, grid).run();
}

}  // namespace stillmap::mapping
