#include "sensing/ego_motion.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace stillmap::simulation {
namespace {

constexpr double kWheelbase = 2.7;
constexpr double kTrack = 1.5;
// The body leans by this much per m/s^2, and swings on its springs by this much at speed [rad].
constexpr double kRollPerAcceleration = 0.008;
constexpr double kPitchPerAcceleration = 0.006;
constexpr double kSwing = 0.0035;
constexpr double kHeave = 0.008;

/// Two frequencies near the natural ones of a car body (1 to 2 Hz) that share no period.
double swing(double time_s, double phase) {
  return 0.6 * std::sin(2.0 * std::numbers::pi * 1.13 * time_s + phase) +
         0.4 * std::sin(2.0 * std::numbers::pi * 1.71 * time_s + 2.3 * phase);
}

}  // namespace

Eigen::Isometry3d EgoMotion::T_world_lidar(double time_s) const {
  constexpr double kH = 0.1;
  const Motion& motion = world_.own_motion;
  const double speed = motion.speed_mps(time_s);
  const double braking =
      (motion.speed_mps(time_s - kH) - motion.speed_mps(time_s + kH)) / (2.0 * kH);
  const double sideways = speed * speed * motion.path->curvature(motion.station(time_s));
  const double moving = std::min(1.0, speed / 5.0);
  const double roll = kRollPerAcceleration * sideways + kSwing * moving * swing(time_s, 0.7);
  const double pitch = kPitchPerAcceleration * braking + kSwing * moving * swing(time_s, 2.1);
  const double heave = kHeave * moving * swing(time_s, 4.2);
  const Eigen::Isometry3d T_world_base = world_.terrain->T_world_standing(
      motion.point(time_s), motion.heading_rad(time_s), kWheelbase, kTrack);
  return T_world_base * Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()) *
         Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitX()) *
         Eigen::Translation3d(0.0, 0.0, height_m_ + heave) * T_usual_lidar_;
}

}  // namespace stillmap::simulation
