#include "ground/cell_prediction.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>

namespace stillmap::mapping {
namespace {

constexpr int kPredictionSide = HeightGrid::kCellsPerSide;
/// Enough nodes for a plane; those farther out weigh next to nothing beside them.
constexpr int kEnough = 6;

[[nodiscard]] int reach_at(double range_m) {
  return std::clamp(static_cast<int>(0.2 * range_m), 2, 6);
}

/// Sums of a weighted plane z = a + b dx + c dy, in cells from the centre.
class WeightedPlane {
 public:
  void add(int dx, int dy, const HeightGrid::Node& node) {
    const int squared = dx * dx + dy * dy;
    const double w = 1.0 / (squared * squared);
    const Eigen::Vector3d row(1.0, dx, dy);
    A_ += w * row * row.transpose();
    b_ += (w * static_cast<double>(node.z)) * row;
    slope_ +=
        w * Eigen::Vector2d(static_cast<double>(node.slope_x), static_cast<double>(node.slope_y));
    nearest_squared_ = count_ == 0 ? squared : std::min(nearest_squared_, squared);
    ++count_;
  }
  [[nodiscard]] int count() const { return count_; }

  [[nodiscard]] CellPrediction solve() const {
    CellPrediction out;
    if (count_ == 0) return out;
    const double weight = A_(0, 0);
    const double pull = 2.0 * weight;
    Eigen::Matrix3d A = A_;
    Eigen::Vector3d b = b_;
    A(1, 1) += pull;
    A(2, 2) += pull;
    b.tail<2>() += pull / weight * slope_;
    const Eigen::Vector3d plane = A.inverse() * b;
    out.z = plane.x();
    out.slope = plane.tail<2>().cwiseMax(-kMaxGroundSlope).cwiseMin(kMaxGroundSlope);
    out.supports = count_;
    out.gap_m = std::sqrt(static_cast<double>(nearest_squared_)) * HeightGrid::kCellM;
    return out;
  }

 private:
  Eigen::Matrix3d A_ = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b_ = Eigen::Vector3d::Zero();
  Eigen::Vector2d slope_ = Eigen::Vector2d::Zero();
  int nearest_squared_ = 0;
  int count_ = 0;
};

void add_if_known(const HeightGrid& grid, int x, int y, int dx, int dy, WeightedPlane& plane) {
  if (x + dx < 0 || x + dx >= kPredictionSide || y + dy < 0 || y + dy >= kPredictionSide) return;
  const HeightGrid::Node& node = grid.node((y + dy) * kPredictionSide + x + dx);
  if (node.confidence > 0.0F) plane.add(dx, dy, node);
}

}  // namespace

CellPrediction predict_from_neighbours(const HeightGrid& grid, int cell, double range_m) {
  const int x = cell % kPredictionSide;
  const int y = cell / kPredictionSide;
  const int reach = reach_at(range_m);
  WeightedPlane plane;
  for (int r = 1; r <= reach && (r <= 2 || plane.count() < kEnough); ++r) {
    for (int d = -r; d <= r; ++d) {
      add_if_known(grid, x, y, d, -r, plane);
      add_if_known(grid, x, y, d, r, plane);
    }
    for (int d = 1 - r; d <= r - 1; ++d) {
      add_if_known(grid, x, y, -r, d, plane);
      add_if_known(grid, x, y, r, d, plane);
    }
  }
  return plane.solve();
}

CellPrediction predict_along_ray(const HeightGrid& grid, int cell, double range_m) {
  const double x = HeightGrid::centre_x(cell);
  const double y = HeightGrid::centre_y(cell);
  for (double gap = reach_at(range_m); gap < 0.5 * range_m; gap += HeightGrid::kCellM) {
    const double scale = 1.0 - gap / range_m;
    const int other =
        HeightGrid::index_of(static_cast<float>(x * scale), static_cast<float>(y * scale));
    const HeightGrid::Node& node = grid.node(other);
    if (node.confidence <= 0.0F) continue;
    const Eigen::Vector2d slope(static_cast<double>(node.slope_x),
                                static_cast<double>(node.slope_y));
    const Eigen::Vector2d step(x - HeightGrid::centre_x(other), y - HeightGrid::centre_y(other));
    return {static_cast<double>(node.z) + slope.dot(step), slope, 1, gap};
  }
  return {};
}

}  // namespace stillmap::mapping
