#include "ground/ground_growth.hpp"

#include "ground/cell_layer.hpp"
#include "ground/cell_prediction.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>

namespace stillmap::mapping {
namespace {

/// Patches and the plane under the sensor start cells up to here [m], where the plane is close; up
/// to where the plane was found when there are few.
constexpr double kStartRangeM = 12.0;
/// Fewer are chance; ground that reaches nearer at all starts more.
constexpr std::size_t kFewestStarts = 6;
constexpr double kStartElevationM = 0.3;
/// How far points may be off a patch's plane [m], as in the fit.
constexpr double kPlaneM = 0.125;
/// A kerb and the noise on it [m]; what sticks out more within a cell or two is an object.
constexpr double kStepM = 0.2;
/// More over a gap, by the change of slope that streets have, and never more than kMaxStepM.
constexpr double kStepPerM = 0.015;
constexpr double kMaxStepM = 0.4;
/// A patch may carry the ground over a gap with a change of slope up to this.
constexpr double kPatchTurn = 0.05;

class Growth {
 public:
  Growth(const CellPoints& points, const Patches& patches, HeightGrid& grid)
      : layout_(PatchLayout::instance()), points_(points), patches_(patches), grid_(grid) {}

  void run(double plane_within_m) {
    if (start(0.0, kStartRangeM) < kFewestStarts) start(kStartRangeM, plane_within_m);
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

  /// Of cells whose range is in (from_m, to_m]. @return how many are ground.
  std::size_t start(double from_m, double to_m) {
    std::size_t started = 0;
    for (const int cell : points_.near_to_far()) {
      if (range_of(cell) > to_m) break;
      if (range_of(cell) <= from_m) continue;
      const auto patch = from_patch(cell);
      const bool on_patch =
          patch && std::abs(patch->z) < kStartElevationM && accept(cell, *patch, kPlaneM);
      const CellPrediction plane{0.0, Eigen::Vector2d::Zero(), 1, 0.0};
      if (on_patch || accept(cell, plane, kPlaneM)) ++started;
    }
    return started;
  }

  void grow() {
    for (const int cell : points_.near_to_far()) {
      if (grid_.node(cell).confidence > 0.0F) continue;
      CellPrediction prediction = predict_from_neighbours(grid_, cell, range_of(cell));
      if (prediction.supports == 0) prediction = predict_along_ray(grid_, cell, range_of(cell));
      if (prediction.supports == 0) continue;
      const double step_m = std::min(kMaxStepM, kStepM + kStepPerM * prediction.gap_m);
      if (accept(cell, prediction, step_m)) continue;
      const auto patch = from_patch(cell);
      if (patch && std::abs(patch->z - prediction.z) < kPatchTurn * prediction.gap_m)
        accept(cell, *patch, kPlaneM);
    }
  }

  /// Makes a cell ground if some of its points lie near the prediction.
  bool accept(int cell, const CellPrediction& prediction, double tolerance_m) {
    const auto node = finder_.find(points_.of_cell(cell), cell, prediction, tolerance_m);
    if (node) grid_.node(cell) = *node;
    return node.has_value();
  }

  void take_back_outliers() {
    std::vector<int> outliers;
    for (const int cell : points_.near_to_far()) {
      const HeightGrid::Node& node = grid_.node(cell);
      if (node.confidence <= 0.0F) continue;
      const CellPrediction prediction = predict_from_neighbours(grid_, cell, range_of(cell));
      // Few neighbours predict less well, the more so the farther their rings are apart.
      const double per_m = prediction.supports < 4 ? 0.01 : 0.002;
      const double off_m = std::abs(static_cast<double>(node.z) - prediction.z);
      if (prediction.supports > 0 && off_m > kStepM + per_m * range_of(cell))
        outliers.push_back(cell);
    }
    for (const int cell : outliers) grid_.node(cell) = HeightGrid::Node{};
  }

  const PatchLayout& layout_;
  const CellPoints& points_;
  const Patches& patches_;
  HeightGrid& grid_;
  CellLayerFinder finder_;
};

}  // namespace

void grow_ground(const CellPoints& points, const Patches& patches, double plane_within_m,
                 HeightGrid& grid) {
  Growth(points, patches, grid).run(plane_within_m);
}

}  // namespace stillmap::mapping
