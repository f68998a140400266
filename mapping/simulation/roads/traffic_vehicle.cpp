#include "roads/traffic_vehicle.hpp"

#include <algorithm>
#include <cmath>

namespace stillmap::simulation {
namespace {

// Intelligent driver model: usual values for town traffic.
constexpr double kBraking = 1.8;
constexpr double kHeadway_s = 1.3;
constexpr double kSideways = 1.6;  // lateral acceleration that bends are taken with [m/s^2]

}  // namespace

double length_of(BodyKind kind) {
  switch (kind) {
    case BodyKind::kArticulatedTruck:
      return 16.5;
    case BodyKind::kBus:
      return 12.0;
    case BodyKind::kTruck:
      return 9.5;
    case BodyKind::kVan:
      return 5.6;
    case BodyKind::kCyclist:
    case BodyKind::kMotorcyclist:
      return 2.2;
    default:
      return 4.6;
  }
}

std::vector<double> allowed_speeds(const Path& path) {
  const auto count = static_cast<std::size_t>(path.length_m()) + 1;
  std::vector<double> speeds(count);
  for (std::size_t i = count; i-- > 0;) {
    const double bend = std::abs(path.curvature(static_cast<double>(i)));
    double speed = std::sqrt(kSideways / std::max(bend, 1e-4));
    if (i + 1 < count) {
      speed = std::min(speed, std::sqrt(speeds[i + 1] * speeds[i + 1] + 2.0 * 0.8 * kBraking));
    }
    speeds[i] = speed;
  }
  return speeds;
}

double on_free_road(const Vehicle& v) {
  const auto at = std::min(static_cast<std::size_t>(v.station), v.allowed.size() - 1);
  const double wish = std::max(0.5, std::min(v.wish_mps, v.allowed[at]));
  return kMostAcceleration * (1.0 - std::pow(v.speed / wish, 4.0));
}

double following(const Vehicle& v, double gap, double speed) {
  const double wanted =
      kStandGap +
      std::max(0.0, v.speed * kHeadway_s + v.speed * (v.speed - speed) /
                                               (2.0 * std::sqrt(kMostAcceleration * kBraking)));
  const double ratio = wanted / std::max(gap, 0.3);
  return -kMostAcceleration * ratio * ratio;
}

}  // namespace stillmap::simulation
