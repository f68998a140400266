#pragma once

#include <array>

#include "geometry/mesh.hpp"
#include "geometry/random.hpp"

namespace stillmap::simulation {

/// A bicycle in its own frame: x forward, the wheels' middle at the origin, tyres on z = 0 [m].
struct Bicycle {
  double wheel_radius_m = 0.34;
  double tyre_m = 0.020;
  double wheelbase_m = 1.06;
  /// Top of the saddle above the bottom bracket, along the seat tube.
  double saddle_m = 0.64;
  double head_tube_m = 0.14;
  /// Frame without a top tube that one would have to step over.
  bool low_step = false;
  /// Flat bar far ahead; else one bent back to the rider.
  bool sporty = false;
  bool mudguards = true;
  bool rack = true;
  bool basket = false;
  bool panniers = false;
  bool kickstand = false;
  double steering_rad = 0.0;
  /// 0 has the left pedal on top; grows as the rider pedals on.
  double crank_rad = 0.0;
  double wheel_turn_rad = 0.0;
};

/// For a rider of that height.
[[nodiscard]] Bicycle draw_bicycle(Random& random, double rider_height_m);

/// Top of the saddle where one sits.
[[nodiscard]] Eigen::Vector3d saddle_of(const Bicycle& bicycle);
/// Left before right, with the steering straight.
[[nodiscard]] std::array<Eigen::Vector3d, 2> grips_of(const Bicycle& bicycle);
/// Middles of the upper sides of the pedals, left before right.
[[nodiscard]] std::array<Eigen::Vector3d, 2> pedals_of(const Bicycle& bicycle);

void add_bicycle(Mesh& mesh, const Bicycle& bicycle);

}  // namespace stillmap::simulation
