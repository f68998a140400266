#pragma once

#include <Eigen/Core>

#include <cstdint>
#include <vector>

#include "bodies/bodies.hpp"
#include "roads/route.hpp"

namespace stillmap::simulation {

/// Gap that is left where one stands in a row [m].
inline constexpr double kStandGap = 2.2;
/// [m/s^2]
inline constexpr double kMostAcceleration = 1.4;

/// Length that others reckon with [m].
[[nodiscard]] double length_of(BodyKind kind);

/// A vehicle while traffic is worked out.
struct Vehicle {
  BodyKind kind = BodyKind::kSaloon;
  std::uint64_t key = 0;
  Route route;
  double wish_mps = 8.0;
  double station = 0.0;
  double speed = 0.0;
  double offset = 0.0;
  /// Where it wants to be beside its path.
  double home_offset = 0.0;
  double wanted_offset = 0.0;
  double enters_s = -1e9;
  bool present = true;
  bool own = false;
  double waited_s = 0.0;
  std::size_t next_stop = 0;
  /// The stop it has waited at long enough (ours only), counted from 1.
  std::size_t released_stop = 0;
  /// Speeds that bends ahead allow, every metre.
  std::vector<double> allowed;
  Motion motion;
  // Of this step, so that each is worked out once.
  Eigen::Vector2d at = Eigen::Vector2d::Zero();
  double heading = 0.0;

  /// There is a lane on its left.
  bool can_pass = false;

  [[nodiscard]] bool cycles() const { return kind == BodyKind::kCyclist; }
  /// How far it watches what is ahead [m].
  [[nodiscard]] double sight_m() const { return 30.0 + 3.0 * speed; }
};

/// Speed at each metre of a path that lets one take every bend to come.
[[nodiscard]] std::vector<double> allowed_speeds(const Path& path);

/// Acceleration with nothing in the way [m/s^2], and the (negative) one that following something at
/// a gap [m] with a speed [m/s] adds: intelligent driver model, see traffic.hpp.
[[nodiscard]] double on_free_road(const Vehicle& vehicle);
[[nodiscard]] double following(const Vehicle& vehicle, double gap_m, double speed_mps);

}  // namespace stillmap::simulation
