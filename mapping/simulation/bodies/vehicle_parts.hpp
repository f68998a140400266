#pragma once

#include "bodies/body_shapes.hpp"
#include "bodies/hull.hpp"
#include "geometry/random.hpp"

namespace stillmap::simulation {

/// A measure as it varies on the road: a bell cut off at both sides.
struct Spread {
  double mean;
  double deviation;
  double least;
  double most;
};
[[nodiscard]] double draw(const Spread& spread, Random& random);

/// A stretch along x [m].
struct Stretch {
  double rear;
  double front;

  [[nodiscard]] bool holds(double x) const { return x > rear && x < front; }
};
[[nodiscard]] bool any_holds(const std::vector<Stretch>& stretches, double x);

/// A pair of wheels whose outer sides are `half_track_m` from the middle, standing on z = 0.
void add_axle(Mesh& mesh, double x, double half_track_m, const Wheel& wheel);

/// Number plate across a face that looks along x, its middle at `centre`.
void add_plate(Mesh& mesh, const Eigen::Vector3d& centre);

/// A pair of outside mirrors at x, standing out `out_m` from the side.
void add_mirrors(Mesh& mesh, const Eigen::Vector3d& left, double out_m,
                 const Eigen::Vector2d& size_m);

/// A seat (or a bench) with a leaning back [m]; `hip` is the middle of the cushion's rear edge.
struct Seat {
  Eigen::Vector3d hip;
  double width_m = 0.5;
  double cushion_m = 0.48;
  double back_m = 0.58;
  int head_rests = 1;
};
void add_seat(Mesh& mesh, const Seat& seat);

/// Somebody at a wheel that lies 0.45 m ahead of the hip.
void add_driver(Mesh& mesh, const Eigen::Vector3d& hip, Random& random);

}  // namespace stillmap::simulation
