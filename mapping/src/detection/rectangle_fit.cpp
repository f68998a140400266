#include "detection/rectangle_fit.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace stillmap::mapping {
namespace {

constexpr int kSteps = 45;
/// Points nearer to a side than this count alike: the noise of the sensor [m].
constexpr double kNoiseM = 0.05;
constexpr double kOutlineM = 0.2;

double distance_to_side(const Eigen::Vector2d& p, const Rectangle& r) {
  const Eigen::Array2d to_min = (p - r.min).array();
  const Eigen::Array2d to_max = (r.max - p).array();
  return to_min.min(to_max).minCoeff();
}

std::vector<Eigen::Vector2d> turned(const std::vector<Eigen::Vector2d>& points, double yaw_rad) {
  const double c = std::cos(yaw_rad), s = std::sin(yaw_rad);
  std::vector<Eigen::Vector2d> out;
  out.reserve(points.size());
  for (const Eigen::Vector2d& p : points)
    out.emplace_back(c * p.x() + s * p.y(), c * p.y() - s * p.x());
  return out;
}

}  // namespace

Eigen::Vector2d Rectangle::to_frame(const Eigen::Vector2d& along) const {
  const double c = std::cos(yaw_rad), s = std::sin(yaw_rad);
  return {c * along.x() - s * along.y(), s * along.x() + c * along.y()};
}

Rectangle fit_rectangle(const std::vector<Eigen::Vector2d>& points) {
  Rectangle best;
  double best_score = -std::numeric_limits<double>::max();
  for (int step = 0; step < kSteps; ++step) {
    Rectangle r;
    r.yaw_rad = step * 0.5 * std::numbers::pi / kSteps;
    const std::vector<Eigen::Vector2d> along = turned(points, r.yaw_rad);
    r.min = r.max = along.front();
    for (const Eigen::Vector2d& p : along) {
      r.min = r.min.cwiseMin(p);
      r.max = r.max.cwiseMax(p);
    }
    double score = 0.0;
    std::size_t on_outline = 0;
    for (const Eigen::Vector2d& p : along) {
      const double distance_m = distance_to_side(p, r);
      score += 1.0 / std::max(distance_m, kNoiseM);
      if (distance_m < kOutlineM) ++on_outline;
    }
    if (score <= best_score) continue;
    best_score = score;
    best = r;
    best.outline_share = static_cast<double>(on_outline) / static_cast<double>(points.size());
  }
  return best;
}

}  // namespace stillmap::mapping
