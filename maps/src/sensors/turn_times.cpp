#include "sensors/turn_times.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace stillmap::maps {
namespace {

constexpr double kTurnRad = 2.0 * std::numbers::pi;
/// Of a turn, for a scan to be one: a quarter may see nothing, and cuts overlap.
constexpr double kLeastTurn = 0.7;
constexpr double kMostTurn = 1.1;
/// Lasers of one firing look to the sides by up to 8 degrees (HDL-64E).
constexpr double kAsideRad = 0.3;
/// Too close to the axis to tell an azimuth.
constexpr float kLeastRangeM = 0.1F;

/// How far each point's azimuth has gone on from the first one's.
std::vector<double> gone_on(const PointCloud& cloud) {
  std::vector<double> turned;
  turned.reserve(cloud.size());
  double total = 0.0, before = 0.0;
  bool is_first = true;
  for (const Eigen::Vector3f& p : cloud.positions) {
    if (p.head<2>().norm() >= kLeastRangeM) {
      const double azimuth = std::atan2(static_cast<double>(p.y()), static_cast<double>(p.x()));
      if (!is_first) total += std::remainder(azimuth - before, kTurnRad);
      before = azimuth;
      is_first = false;
    }
    turned.push_back(total);
  }
  return turned;
}

}  // namespace

void set_turn_times(PointCloud& cloud, double period_s, double stamp_at) {
  std::vector<double> turned = gone_on(cloud);
  if (turned.empty()) return;
  if (turned.back() < 0.0)
    for (double& angle : turned) angle = -angle;
  const auto [least, most] = std::minmax_element(turned.begin(), turned.end());
  const bool is_one_turn = turned.back() >= kLeastTurn * kTurnRad &&
                           *most <= kMostTurn * kTurnRad + kAsideRad && *least >= -kAsideRad;
  if (!is_one_turn) return;
  // And steadily: most points are no further back than lasers look aside.
  double farthest = 0.0;
  std::size_t behind = 0;
  for (const double angle : turned) {
    farthest = std::max(farthest, angle);
    behind += angle < farthest - 2.0 * kAsideRad ? 1 : 0;
  }
  if (behind * 20 > turned.size()) return;
  cloud.time_offsets_s.clear();
  for (const double angle : turned)
    cloud.time_offsets_s.push_back(static_cast<float>(period_s * (angle / kTurnRad - stamp_at)));
}

}  // namespace stillmap::maps
