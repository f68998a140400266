#include "ego_motion.hpp"

#include <cmath>
#include <numbers>

namespace stillmap::simulation {
namespace {

constexpr double kSpeed = 8.0;
constexpr double kSpeedChange = 1.0;
constexpr double kSpeedPeriod = 9.0;
constexpr double kSway = 0.2;
constexpr double kSwayLength = 35.0;

double wave(double x, double period) { return std::sin(2.0 * std::numbers::pi * x / period); }

}  // namespace

double EgoMotion::driven_m(double time_s) {
  const double swing = kSpeedChange * kSpeedPeriod / (2.0 * std::numbers::pi);
  return kSpeed * time_s + swing * wave(time_s, kSpeedPeriod);
}

Eigen::Isometry3d EgoMotion::T_world_lidar(const Road& road, double time_s) const {
  const double s = driven_m(time_s);
  const double d = -StreetSection::kLaneMiddle + kSway * wave(s, kSwayLength);
  // The vehicle points along its own path, which the sway turns against the street.
  const double ahead = -StreetSection::kLaneMiddle + kSway * wave(s + 0.5, kSwayLength);
  const double yaw = std::atan2(ahead - d, 0.5);
  return road.T_world_ground(s, d, yaw) * Eigen::Translation3d(0.0, 0.0, lidar_height_m_);
}

}  // namespace stillmap::simulation
