#include "ground/ground_growth.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <optional>
#include <span>
#include <utility>

namespace stillmap::mapping {
namespace {

constexpr int kSide = HeightGrid::kCellsPerSide;
/// Steepest ground over the plane under the sensor: a street that bends by 10 %, and a ramp.
constexpr double kMaxSlope = 0.35;
/// A kerb and the noise on it [m]; what sticks out more within a cell or two is an object.
constexpr double kStepM = 0.2;
/// The same where something stands in the cell: its lower edge is no kerb.
constexpr double kStepBesideM = 0.08;
/// A thing that stands is seen between these heights [m]; crowns and signs begin above.
constexpr float kStandingFromM = 0.35F;
constexpr float kStandingToM = 2.0F;
/// Range [m] up to which a cell may start the growth.
constexpr double kStartRangeM = 12.0;

/// What the ground around a cell says about it.
struct Prediction {
  double z = 0.0;
  Eigen::Vector2d slope = Eigen::Vector2d::Zero();
  int supports = 0;
  /// Distance to the nearest support [m].
  double gap_m = 0.0;
};

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
  [[nodiscard]] std::optional<Prediction> from_patch(int cell) const {
    const int patch = layout_.patch_of_cell[static_cast<std::size_t>(cell)];
    if (patch < 0 || patches_.verdicts[static_cast<std::size_t>(patch)] != PatchVerdict::kGround)
      return std::nullopt;
    const PlaneFit& plane = patches_.planes[static_cast<std::size_t>(patch)];
    const Eigen::Vector2d slope = -plane.normal.head<2>() / plane.normal.z();
    if (slope.norm() > kMaxSlope) return std::nullopt;
    return Prediction{plane.height_at(HeightGrid::centre_x(cell), HeightGrid::centre_y(cell)),
                      slope, 1, 0.0};
  }

  void start() {
    for (const int cell : points_.near_to_far()) {
      if (range_of(cell) > kStartRangeM) break;
      const auto patch = from_patch(cell);
      if (patch && std::abs(patch->z) < 0.3 && accept(cell, *patch, 0.12)) continue;
      accept(cell, Prediction{0.0, Eigen::Vector2d::Zero(), 1, 0.0}, 0.12);
    }
  }

  void grow() {
    for (const int cell : points_.near_to_far()) {
      if (grid_.node(cell).confidence > 0.0F) continue;
      Prediction prediction = predict(cell);
      if (prediction.supports == 0) prediction = predict_along_ray(cell);
      if (prediction.supports == 0) continue;
      if (accept(cell, prediction, std::min(0.4, kStepM + 0.015 * prediction.gap_m))) continue;
      const auto patch = from_patch(cell);
      if (patch && std::abs(patch->z - prediction.z) < kStepM + 0.1 * prediction.gap_m)
        accept(cell, *patch, 0.12);
    }
  }

  /// Cells searched around one: the rings of a spinning sensor part with the range.
  [[nodiscard]] static int window(double range_m) {
    return std::clamp(static_cast<int>(0.2 * range_m), 2, 6);
  }

  /// Weighted plane through the ground found around a cell, itself left out. The slope is drawn to
  /// the mean slope of those cells, without which a single ring would leave it free across.
  [[nodiscard]] Prediction predict(int cell) const {
    const int cx = cell % kSide;
    const int cy = cell / kSide;
    const int reach = window(range_of(cell));
    Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
    Eigen::Vector3d b = Eigen::Vector3d::Zero();
    Eigen::Vector2d mean_slope = Eigen::Vector2d::Zero();
    double weight = 0.0;
    int nearest_squared = 1 << 20;
    Prediction prediction;
    for (int iy = std::max(0, cy - reach); iy <= std::min(kSide - 1, cy + reach); ++iy) {
      for (int ix = std::max(0, cx - reach); ix <= std::min(kSide - 1, cx + reach); ++ix) {
        const HeightGrid::Node& n = grid_.node(iy * kSide + ix);
        const int squared = (ix - cx) * (ix - cx) + (iy - cy) * (iy - cy);
        if (n.confidence <= 0.0F || squared == 0) continue;
        const double w = 1.0 / (squared * squared);
        const Eigen::Vector3d row(1.0, ix - cx, iy - cy);
        A += w * row * row.transpose();
        b += w * static_cast<double>(n.z) * row;
        mean_slope += w * Eigen::Vector2d(static_cast<double>(n.slope_x), static_cast<double>(n.slope_y));
        weight += w;
        ++prediction.supports;
        nearest_squared = std::min(nearest_squared, squared);
      }
    }
    if (prediction.supports == 0) return prediction;
    mean_slope /= weight;
    const double pull = 2.0 * weight;
    A(1, 1) += pull;
    A(2, 2) += pull;
    b.tail<2>() += pull * mean_slope;
    const Eigen::Vector3d plane = A.ldlt().solve(b);
    prediction.z = plane.x();
    prediction.slope = plane.tail<2>().cwiseMax(-kMaxSlope).cwiseMin(kMaxSlope);
    prediction.gap_m = std::sqrt(static_cast<double>(nearest_squared)) * HeightGrid::kCellM;
    return prediction;
  }

  /// The next ground on the way to the sensor, up to half of the range away: sparse rings far out.
  [[nodiscard]] Prediction predict_along_ray(int cell) const {
    const double x = HeightGrid::centre_x(cell);
    const double y = HeightGrid::centre_y(cell);
    const double range = std::hypot(x, y);
    for (double gap = window(range); gap < 0.5 * range; gap += HeightGrid::kCellM) {
      const double scale = 1.0 - gap / range;
      const int other =
          HeightGrid::index_of(static_cast<float>(x * scale), static_cast<float>(y * scale));
      const HeightGrid::Node& n = grid_.node(other);
      if (n.confidence <= 0.0F) continue;
      const Eigen::Vector2d slope(static_cast<double>(n.slope_x), static_cast<double>(n.slope_y));
      const Eigen::Vector2d step(x - HeightGrid::centre_x(other), y - HeightGrid::centre_y(other));
      return Prediction{static_cast<double>(n.z) + slope.dot(step), slope, 1, gap};
    }
    return {};
  }

  /// Makes a cell ground if some of its points lie near the prediction.
  bool accept(int cell, const Prediction& prediction, double tolerance_m) {
    const auto cx = static_cast<float>(HeightGrid::centre_x(cell));
    const auto cy = static_cast<float>(HeightGrid::centre_y(cell));
    const Eigen::Vector2f slope = prediction.slope.cast<float>();
    const auto z = static_cast<float>(prediction.z);
    const auto tolerance = static_cast<float>(tolerance_m);
    const auto beside = static_cast<float>(std::min(tolerance_m, kStepBesideM + tolerance_m - kStepM > 0.0 ? kStepBesideM + std::max(0.0, tolerance_m - kStepM) : kStepBesideM));
    const auto above = [&](const CellPoint& p) {
      return p.z - z - slope.x() * (p.x - cx) - slope.y() * (p.y - cy);
    };
    float lowest = tolerance;
    bool stands = false;
    for (const CellPoint& p : points_.of_cell(cell)) {
      const float r = above(p);
      if (r >= -tolerance && r < lowest) lowest = r;
      stands = stands || (r > kStandingFromM && r < kStandingToM);
    }
    if (lowest >= (stands ? beside : tolerance)) return false;
    // Mean over the layer on top of the lowest point; thin enough to leave a kerb's upper side out.
    double sum = 0.0;
    int count = 0;
    for (const CellPoint& p : points_.of_cell(cell)) {
      const float r = above(p);
      if (r < lowest || r > lowest + 0.1F) continue;
      sum += static_cast<double>(r);
      ++count;
    }
    grid_.node(cell) =
        HeightGrid::Node{z + static_cast<float>(sum / count), slope.x(), slope.y(), 1.0F};
    return true;
  }

  void take_back_outliers() {
    std::vector<std::pair<int, HeightGrid::Node>> checked;
    for (const int cell : points_.near_to_far()) {
      const HeightGrid::Node& n = grid_.node(cell);
      if (n.confidence <= 0.0F) continue;
      const Prediction prediction = predict(cell);
      HeightGrid::Node after = n;
      after.slope_x = static_cast<float>(prediction.slope.x());
      after.slope_y = static_cast<float>(prediction.slope.y());
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
};

}  // namespace

void grow_ground(const CellPoints& points, const Patches& patches, HeightGrid& grid) {
  Growth(points, patches, grid).run();
}

}  // namespace stillmap::mapping
