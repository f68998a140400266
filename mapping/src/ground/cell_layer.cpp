#include "ground/cell_layer.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <array>
#include <cstdlib>
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wfloat-conversion"

namespace stillmap::mapping {
namespace {

/// A thing that stands is seen between these heights [m]; crowns and signs begin above.
constexpr float kStandingFromM = 0.35F;
constexpr float kStandingToM = 3.0F;
/// Thickness of the layer; a kerb's upper side is left out.
constexpr float kLayerM = 0.1F;
/// Without ground in a neighbouring cell one thing that stands spoils the whole cell: slanted
/// sides of cars and sparse beams leave columns that look free.
constexpr double kAdjacentM = 1.5;

}  // namespace

std::optional<HeightGrid::Node> CellLayerFinder::find(std::span<const CellPoint> points, int cell,
                                                      const CellPrediction& prediction,
                                                      double tolerance_m) {
  const auto x0 = static_cast<float>(HeightGrid::centre_x(cell));
  const auto y0 = static_cast<float>(HeightGrid::centre_y(cell));
  const Eigen::Vector2f slope = prediction.slope.cast<float>();
  const auto z = static_cast<float>(prediction.z);
  const auto tolerance = static_cast<float>(tolerance_m);
  above_.resize(points.size());
  column_.resize(points.size());
  std::array<bool, 4> stands{};
  float lowest_anywhere = tolerance;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const CellPoint& p = points[i];
    above_[i] = p.z - z - slope.x() * (p.x - x0) - slope.y() * (p.y - y0);
    column_[i] = static_cast<std::uint8_t>((p.x < x0 ? 0 : 1) + (p.y < y0 ? 0 : 2));
    if (above_[i] > kStandingFromM && above_[i] < kStandingToM) stands[column_[i]] = true;
    if (above_[i] >= -tolerance) lowest_anywhere = std::min(lowest_anywhere, above_[i]);
  }
  if (lowest_anywhere >= tolerance) return std::nullopt;
  const bool any = std::any_of(stands.begin(), stands.end(), [](bool s) { return s; });
  if (any && prediction.gap_m > kAdjacentM) return std::nullopt;
  float lowest = tolerance;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (stands[column_[i]] || above_[i] < -tolerance) continue;
    lowest = std::min(lowest, above_[i]);
  }
  if (lowest >= tolerance) return std::nullopt;
  double sum = 0.0;
  int count = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (stands[column_[i]] || above_[i] < lowest || above_[i] > lowest + kLayerM) continue;
    sum += static_cast<double>(above_[i]);
    ++count;
  }
  float r0 = static_cast<float>(sum / count), sx = 0, sy = 0;
  static const double ridge = getenv("RIDGE") ? atof(getenv("RIDGE")) : 0;
  static const double band = getenv("BAND") ? atof(getenv("BAND")) : 0.08;
  static const double dslope = getenv("DSLOPE") ? atof(getenv("DSLOPE")) : 0.3;
  if (ridge > 0) {
    for (int it = 0; it < 2; ++it) {
      Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
      Eigen::Vector3d b = Eigen::Vector3d::Zero();
      for (std::size_t i = 0; i < points.size(); ++i) {
        if (stands[column_[i]]) continue;
        const float dx = points[i].x - x0, dy = points[i].y - y0;
        if (std::abs(above_[i] - r0 - sx * dx - sy * dy) > band) continue;
        const Eigen::Vector3d row(1, dx, dy);
        A += row * row.transpose();
        b += row * above_[i];
      }
      if (A(0, 0) < 1) break;
      const double k = ridge * 1.0;
      A(1, 1) += k;
      A(2, 2) += k;
      const Eigen::Vector3d s = A.inverse() * b;
      sx = std::clamp(s[1], -dslope, dslope);
      sy = std::clamp(s[2], -dslope, dslope);
      r0 = s[0];
    }
  }
  return HeightGrid::Node{z + r0, slope.x() + sx, slope.y() + sy, 1.0F};
}

}  // namespace stillmap::mapping
