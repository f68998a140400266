#include "fusion/box_estimate.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>

namespace stillmap::mapping {
namespace {

using Values = std::vector<std::pair<double, double>>;

/// Boxes from here count half [m].
constexpr double kHalfWeightM = 15.0;
/// Weight of a side that the sensor could not see over that of one it faced.
constexpr double kGuessedWeight = 0.15;
/// Sides lie a little further out than the median hit: what is cut off stays in the map.
constexpr double kSideQuantile = 0.6;
constexpr double kTopQuantile = 0.75;
constexpr double kSizeQuantile = 0.7;
/// Directions are voted for in bins of 2 degrees and averaged around the best one.
constexpr int kYawBins = 90;
constexpr int kYawReach = 4;

double distance_m(const Hit& hit) { return (hit.box.centre.head<2>() - hit.sensor).norm(); }

double weight_of(const Hit& hit) {
  const double far = distance_m(hit) / kHalfWeightM;
  return std::max(hit.box.score, 0.05) / (1.0 + far * far);
}

/// Mean direction modulo pi of the hits around the most voted one, then the way most hits head.
double common_yaw_rad(const std::vector<Hit>& hits) {
  const double bin_rad = std::numbers::pi / kYawBins;
  std::array<double, kYawBins> votes{};
  const auto bin_of = [&](double yaw_rad) {
    const double turns = yaw_rad / std::numbers::pi;
    const int bin = static_cast<int>(std::floor((turns - std::floor(turns)) * kYawBins));
    return std::clamp(bin, 0, kYawBins - 1);
  };
  for (const Hit& hit : hits) {
    const int bin = bin_of(hit.box.yaw_rad);
    // Neighbouring bins share, so that no border splits a vote.
    for (int d = -2; d <= 2; ++d) {
      const auto at = static_cast<std::size_t>((bin + d + kYawBins) % kYawBins);
      votes[at] += weight_of(hit) / (1.0 + std::abs(d));
    }
  }
  const auto best = std::max_element(votes.begin(), votes.end()) - votes.begin();
  const double centre_rad = (static_cast<double>(best) + 0.5) * bin_rad;
  double sum_rad = 0.0, sum = 0.0;
  for (const Hit& hit : hits) {
    const double off_rad = std::remainder(hit.box.yaw_rad - centre_rad, std::numbers::pi);
    if (std::abs(off_rad) > kYawReach * bin_rad) continue;
    sum_rad += weight_of(hit) * off_rad;
    sum += weight_of(hit);
  }
  const double yaw_rad = centre_rad + (sum > 0.0 ? sum_rad / sum : 0.0);
  double forward = 0.0;
  for (const Hit& hit : hits) forward += weight_of(hit) * std::cos(hit.box.yaw_rad - yaw_rad);
  return forward >= 0.0 ? yaw_rad : yaw_rad + std::numbers::pi;
}

/// Where a hit's four sides lie along two axes, with weights.
struct Sides {
  std::array<Values, 2> low, high;
};

void add_sides(const Hit& hit, const std::array<Eigen::Vector2d, 2>& axes, Sides& sides) {
  const Eigen::Vector2d centre = hit.box.centre.head<2>();
  const Eigen::Vector2d heading(std::cos(hit.box.yaw_rad), std::sin(hit.box.yaw_rad));
  // Length along the nearer of both axes: a rear alone is as often taken for a side.
  const std::size_t length_axis =
      std::abs(heading.dot(axes[0])) >= std::abs(heading.dot(axes[1])) ? 0 : 1;
  for (std::size_t axis = 0; axis < 2; ++axis) {
    const double half_m = 0.5 * hit.box.size_m[axis == length_axis ? 0 : 1];
    const double middle = axes[axis].dot(centre);
    const double sensor = axes[axis].dot(hit.sensor);
    const double weight = weight_of(hit);
    const bool low_hidden = sensor > middle + half_m;
    const bool high_hidden = sensor < middle - half_m;
    sides.low[axis].emplace_back(middle - half_m, weight * (low_hidden ? kGuessedWeight : 1.0));
    sides.high[axis].emplace_back(middle + half_m, weight * (high_hidden ? kGuessedWeight : 1.0));
  }
}

}  // namespace

double weighted_quantile(Values values, double q) {
  std::sort(values.begin(), values.end());
  double total = 0.0;
  for (const auto& [value, weight] : values) total += weight;
  double below = 0.0;
  for (const auto& [value, weight] : values) {
    below += weight;
    if (below >= q * total) return value;
  }
  return values.back().first;
}

maps::ObjectClass class_of(const std::vector<Hit>& hits) {
  std::map<maps::ObjectClass, double> votes;
  for (const Hit& hit : hits) votes[hit.box.object_class] += weight_of(hit);
  const auto most = std::max_element(
      votes.begin(), votes.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  return most->first;
}

Eigen::Vector3d size_of(const std::vector<Hit>& hits) {
  Eigen::Vector3d size_m;
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    Values values;
    for (const Hit& hit : hits) values.emplace_back(hit.box.size_m[axis], weight_of(hit));
    size_m[axis] = weighted_quantile(std::move(values), kSizeQuantile);
  }
  return size_m;
}

Eigen::Vector2d aligned_centre(const Hit& hit, const Eigen::Vector3d& size_m) {
  const Eigen::Vector2d along(std::cos(hit.box.yaw_rad), std::sin(hit.box.yaw_rad));
  const std::array<Eigen::Vector2d, 2> axes{along, Eigen::Vector2d(-along.y(), along.x())};
  Eigen::Vector2d centre = hit.box.centre.head<2>();
  const Eigen::Vector2d to_sensor = hit.sensor - centre;
  for (std::size_t axis = 0; axis < 2; ++axis) {
    const auto a = static_cast<Eigen::Index>(axis);
    const double half_m = 0.5 * hit.box.size_m[a];
    const double lacking_m = 0.5 * size_m[a] - half_m;
    const double sensor = axes[axis].dot(to_sensor);
    if (std::abs(sensor) > half_m) centre -= (sensor > 0.0 ? lacking_m : -lacking_m) * axes[axis];
  }
  return centre;
}

maps::Box standing_box(const std::vector<Hit>& hits) {
  const double yaw_rad = common_yaw_rad(hits);
  const Eigen::Vector2d along(std::cos(yaw_rad), std::sin(yaw_rad));
  const std::array<Eigen::Vector2d, 2> axes{along, Eigen::Vector2d(-along.y(), along.x())};
  Sides sides;
  Values bottoms, tops;
  for (const Hit& hit : hits) {
    add_sides(hit, axes, sides);
    bottoms.emplace_back(hit.box.centre.z() - 0.5 * hit.box.size_m.z(), weight_of(hit));
    tops.emplace_back(hit.box.centre.z() + 0.5 * hit.box.size_m.z(), weight_of(hit));
  }
  maps::Box box;
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  for (std::size_t axis = 0; axis < 2; ++axis) {
    double low = weighted_quantile(sides.low[axis], 1.0 - kSideQuantile);
    double high = weighted_quantile(sides.high[axis], kSideQuantile);
    if (!(high > low)) std::swap(low, high);
    centre += 0.5 * (low + high) * axes[axis];
    box.size_m[static_cast<Eigen::Index>(axis)] = std::max(high - low, 0.1);
  }
  const double bottom = weighted_quantile(std::move(bottoms), 1.0 - kTopQuantile);
  const double top = weighted_quantile(std::move(tops), kTopQuantile);
  box.centre = {centre.x(), centre.y(), 0.5 * (bottom + top)};
  box.size_m.z() = std::max(top - bottom, 0.1);
  box.yaw_rad = std::atan2(along.y(), along.x());
  box.object_class = class_of(hits);
  return box;
}

}  // namespace stillmap::mapping
