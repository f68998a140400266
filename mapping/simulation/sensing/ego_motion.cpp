#include "sensing/ego_motion.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace stillmap::simulation {
namespace {

constexpr double kWheelbase = 2.7;
constexpr double kTrack = 1.5;

/// How a body moves on its springs.
struct Springs {
  /// Lean by this much per m/s^2 [rad].
  double roll;
  double pitch;
  /// Swing by this much at speed [rad], [m].
  double swing_rad;
  double heave_m;
  /// Swerving: to the sides [m].
  double swerve_m;
};
constexpr Springs kSoft{0.008, 0.006, 0.0035, 0.008, 0.0};
/// Ten times the swing of the road: a track, kerbs and holes taken at speed.
constexpr Springs kRough{0.012, 0.010, 0.035, 0.05, 0.8};

constexpr double kFastPace = 2.0;
/// 1.5 m/s where a car drives at 8.3 m/s.
constexpr double kHandPace = 0.18;
/// To the right of the lane, where nobody drives.
constexpr double kBesideLaneM = 3.0;
/// A step takes half of that time [s] (Winter, "Biomechanics and Motor Control of Human Movement").
constexpr double kStrideS = 1.1;

/// Two frequencies near the natural ones of a car body (1 to 2 Hz) that share no period.
double swing(double time_s, double phase) {
  return 0.6 * std::sin(2.0 * std::numbers::pi * 1.13 * time_s + phase) +
         0.4 * std::sin(2.0 * std::numbers::pi * 1.71 * time_s + 2.3 * phase);
}

/// A sine of a period.
double sway(double time_s, double period_s, double phase) {
  return std::sin(2.0 * std::numbers::pi * time_s / period_s + phase);
}

}  // namespace

std::string carrier_names() { return "vehicle fast hand"; }

std::optional<Carrier> carrier_named(const std::string& name) {
  if (name == "vehicle") return Carrier::kVehicle;
  if (name == "fast") return Carrier::kFast;
  if (name == "hand") return Carrier::kHand;
  return std::nullopt;
}

double pace_of(Carrier carrier) {
  if (carrier == Carrier::kFast) return kFastPace;
  return carrier == Carrier::kHand ? kHandPace : 1.0;
}

Eigen::Isometry3d EgoMotion::T_world_lidar(double time_s) const {
  return carrier_ == Carrier::kHand ? T_world_in_hand(time_s) : T_world_on_wheels(time_s);
}

Eigen::Isometry3d EgoMotion::T_world_on_wheels(double time_s) const {
  constexpr double kH = 0.1;
  const Springs& springs = carrier_ == Carrier::kFast ? kRough : kSoft;
  const double pace = pace_of(carrier_);
  const double own_s = pace * time_s;
  const Motion& motion = world_.own_motion;
  const double speed = pace * motion.speed_mps(own_s);
  const double braking =
      pace * pace * (motion.speed_mps(own_s - kH) - motion.speed_mps(own_s + kH)) / (2.0 * kH);
  const double sideways = speed * speed * motion.path->curvature(motion.station(own_s));
  const double moving = std::min(1.0, speed / 5.0);
  const double roll = springs.roll * sideways + springs.swing_rad * moving * swing(time_s, 0.7);
  const double pitch = springs.pitch * braking + springs.swing_rad * moving * swing(time_s, 2.1);
  const double heave = springs.heave_m * moving * swing(time_s, 4.2);
  Eigen::Vector2d point = motion.point(own_s);
  double heading = motion.heading_rad(own_s);
  if (springs.swerve_m > 0.0) {
    constexpr double kSwerveS = 2.7;
    const double rate = 2.0 * std::numbers::pi / kSwerveS;
    point += springs.swerve_m * moving * sway(time_s, kSwerveS, 0.0) *
             Eigen::Vector2d(-std::sin(heading), std::cos(heading));
    heading += std::atan2(springs.swerve_m * moving * rate * std::cos(rate * time_s),
                          std::max(speed, 1.0));
  }
  const Eigen::Isometry3d T_world_base =
      world_.terrain->T_world_standing(point, heading, kWheelbase, kTrack);
  return T_world_base * Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()) *
         Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitX()) *
         Eigen::Translation3d(0.0, 0.0, height_m_ + heave) * T_usual_lidar_;
}

/// The body bobs and sways with each step, the hand looks around: rates of up to some 2 rad/s.
Eigen::Isometry3d EgoMotion::T_world_in_hand(double time_s) const {
  const Motion& motion = world_.own_motion;
  const double own_s = kHandPace * time_s;
  const double along = motion.path->heading_rad(motion.station(own_s));
  const Eigen::Vector2d left(-std::sin(along), std::cos(along));
  const double bob_m = 0.025 * sway(time_s, 0.5 * kStrideS, 0.0);
  const double sideways_m = 0.03 * sway(time_s, kStrideS, 0.4);
  const double yaw = 0.45 * sway(time_s, 3.1, 0.0) + 0.20 * sway(time_s, 1.3, 1.0) +
                     0.05 * sway(time_s, kStrideS, 0.0);
  const double pitch = 0.15 * sway(time_s, 2.3, 2.0) + 0.05 * sway(time_s, 0.5 * kStrideS, 0.5);
  const double roll = 0.12 * sway(time_s, 1.9, 4.0) + 0.05 * sway(time_s, kStrideS, 1.5);
  const Eigen::Vector2d point = motion.point(own_s) - (kBesideLaneM - sideways_m) * left;
  Eigen::Isometry3d T = world_.terrain->T_world_upright(point, along + yaw);
  return T * Eigen::Translation3d(0.0, 0.0, height_m_ + bob_m) *
         Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()) *
         Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitX()) * T_usual_lidar_;
}

}  // namespace stillmap::simulation
