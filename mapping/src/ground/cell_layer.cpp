#include "ground/cell_layer.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>

namespace stillmap::mapping {
namespace {

/// Thickness of the layer on its lowest point [m]; a kerb's upper side is left out.
constexpr float kCellLayerM = 0.1F;
/// Points this far off the layer's plane [m] are part of it.
constexpr double kBandM = 0.08;
/// The layer's slope may differ by as much from the predicted one.
constexpr double kMaxTurn = 0.3;
/// Points beyond the tolerance that a turned plane may still reach, half a diagonal away [m].
constexpr float kTurnReachM = 0.3F;
/// Pull of the predicted slope, as strong as one point at 1 m: a lone ring leaves the slope across
/// it to the prediction.
constexpr double kSlopePull = 1.0;
constexpr int kFits = 2;
/// Beyond this, no neighbouring cell has ground [m].
constexpr double kAdjacentM = 1.5;

/// A plane above the predicted one: a + b x + c y.
struct Plane {
  double a = 0.0, b = 0.0, c = 0.0;
};

/// One step of a fit to the points near the plane.
template <typename Points>
[[nodiscard]] Plane refit(const Points& points, const Plane& plane) {
  double n = 0.0, x = 0.0, y = 0.0, xx = kSlopePull, xy = 0.0, yy = kSlopePull;
  double r = 0.0, xr = 0.0, yr = 0.0;
  for (const auto& p : points) {
    const auto px = static_cast<double>(p.x), py = static_cast<double>(p.y);
    const auto pr = static_cast<double>(p.above);
    if (std::abs(pr - plane.a - plane.b * px - plane.c * py) > kBandM) continue;
    n += 1.0;
    x += px;
    y += py;
    xx += px * px;
    xy += px * py;
    yy += py * py;
    r += pr;
    xr += px * pr;
    yr += py * pr;
  }
  if (n < 1.0) return plane;
  Eigen::Matrix3d A;
  A << n, x, y, x, xx, xy, y, xy, yy;
  const Eigen::Vector3d s = A.inverse() * Eigen::Vector3d(r, xr, yr);
  return {s[0], std::clamp(s[1], -kMaxTurn, kMaxTurn), std::clamp(s[2], -kMaxTurn, kMaxTurn)};
}

}  // namespace

void CellLayerFinder::collect(std::span<const CellPoint> points, int cell,
                              const CellPrediction& prediction, float tolerance_m) {
  const auto x0 = static_cast<float>(HeightGrid::centre_x(cell));
  const auto y0 = static_cast<float>(HeightGrid::centre_y(cell));
  const auto z = static_cast<float>(prediction.z);
  const Eigen::Vector2f slope = prediction.slope.cast<float>();
  const float reach = tolerance_m + kTurnReachM;
  near_.clear();
  stands_ = {};
  for (const CellPoint& p : points) {
    const float x = p.x - x0, y = p.y - y0;
    const float above = p.z - z - slope.x() * x - slope.y() * y;
    const auto quarter = static_cast<std::uint8_t>((x < 0.0F ? 0 : 1) + (y < 0.0F ? 0 : 2));
    if (above > kStandingFromM && above < kStandingToM) stands_[quarter] = true;
    if (above > -reach && above < reach) near_.push_back({x, y, above, quarter});
  }
}

void CellLayerFinder::drop_standing_quarters() {
  std::erase_if(near_, [&](const NearPoint& p) { return stands_[p.quarter]; });
}

std::optional<float> CellLayerFinder::lowest(float tolerance_m) const {
  float lowest_m = tolerance_m;
  for (const NearPoint& p : near_) {
    if (p.above >= -tolerance_m) lowest_m = std::min(lowest_m, p.above);
  }
  if (lowest_m >= tolerance_m) return std::nullopt;
  return lowest_m;
}

std::optional<HeightGrid::Node> CellLayerFinder::find(std::span<const CellPoint> points, int cell,
                                                      const CellPrediction& prediction,
                                                      double tolerance_m) {
  const auto tolerance = static_cast<float>(tolerance_m);
  collect(points, cell, prediction, tolerance);
  const bool any = std::any_of(stands_.begin(), stands_.end(), [](bool s) { return s; });
  if (any && prediction.gap_m > kAdjacentM) return std::nullopt;
  if (any) drop_standing_quarters();
  const auto lowest_m = lowest(tolerance);
  if (!lowest_m) return std::nullopt;
  Plane plane;
  double count = 0.0;
  for (const NearPoint& p : near_) {
    if (p.above < *lowest_m || p.above > *lowest_m + kCellLayerM) continue;
    plane.a += static_cast<double>(p.above);
    count += 1.0;
  }
  plane.a /= count;
  for (int k = 0; k < kFits; ++k) plane = refit(near_, plane);
  return HeightGrid::Node{static_cast<float>(prediction.z + plane.a),
                          static_cast<float>(prediction.slope.x() + plane.b),
                          static_cast<float>(prediction.slope.y() + plane.c), 1.0F};
}

}  // namespace stillmap::mapping
