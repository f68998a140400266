#include "bodies/heavy_vehicle_bodies.hpp"

#include <algorithm>

#include "bodies/heavy_parts.hpp"

namespace stillmap::simulation {
namespace {

using Eigen::Vector3d;

Wheel draw_wheel(Random& random) {
  const double radius = random.uniform(0.46, 0.52);
  return {.radius_m = radius, .width_m = 0.30, .rim_radius_m = 0.58 * radius};
}

Wheel twin(Wheel wheel) {
  wheel.width_m = 0.58;
  return wheel;
}

/// Tanks, battery boxes and the like that hang beside the frame.
void add_tanks(Mesh& mesh, const Stretch& x, double half_width_m, double top_m, Random& random) {
  for (const double side : {1.0, -1.0}) {
    const double length = random.uniform(0.5, std::max(0.55, std::min(1.4, x.front - x.rear)));
    const double y = side * (half_width_m - 0.36);
    const Surface surface = random.chance(0.5) ? Surface::kChrome : Surface::kTrim;
    add_limb(mesh,
             {{{x.front - length, y, top_m - 0.42}, 0.27}, {{x.front, y, top_m - 0.42}, 0.27}},
             surface, 8);
    add_block(mesh, {x.front - 0.5 * length - 0.1, std::min(y, 0.4 * side), top_m - 0.3},
              {x.front - 0.5 * length + 0.1, std::max(y, 0.4 * side), top_m - 0.2}, Surface::kTrim);
  }
}

/// Stays of the driver's cab to the body behind it.
Cab draw_cab(double front_x, double length, double width_left, Random& random) {
  Cab cab;
  cab.front_x = front_x;
  cab.length_m = length;
  cab.half_width_m = width_left;
  cab.wheel = draw_wheel(random);
  cab.axle_x = front_x - random.uniform(1.15, 1.35);
  return cab;
}

void add_legs(Mesh& mesh, double x, double floor_m, double foot_m) {
  for (const double y : {-0.85, 0.75}) {
    add_block(mesh, {x - 0.05, y, foot_m}, {x + 0.05, y + 0.10, floor_m + 0.02}, Surface::kTrim);
    add_block(mesh, {x - 0.13, y - 0.08, foot_m}, {x + 0.13, y + 0.18, foot_m + 0.03},
              Surface::kTrim);
  }
}

/// A semi-trailer of 13.6 m whose rear is at `rear_x`.
void add_semi_trailer(Mesh& mesh, double rear_x, double foot_m, Random& random) {
  LoadBody body;
  body.kind = random.chance(0.65) ? LoadKind::kTarpaulin : LoadKind::kBox;
  body.x = {rear_x + 0.03, rear_x + 13.6};
  body.floor_m = random.uniform(1.10, 1.18);
  body.top_m = random.uniform(3.85, 4.0);
  add_load_body(mesh, body, random);
  const double w = body.half_width_m;
  const double bogie = rear_x + random.uniform(3.6, 4.1);
  Wheel wheel = draw_wheel(random);
  wheel.radius_m = std::min(wheel.radius_m, 0.5);
  wheel.width_m = 0.38;
  add_rear_axles(mesh, {bogie - 1.31, bogie, bogie + 1.31}, w, wheel);
  add_frame(mesh, {rear_x + 0.1, body.x.front - 0.6}, body.floor_m + 0.01);
  const double legs = body.x.front - random.uniform(3.9, 4.2);
  add_legs(mesh, legs, body.floor_m, foot_m);
  add_side_guards(mesh, {bogie + 2.0, legs - 0.3}, w);
  add_underrun_bar(mesh, rear_x, w, body.floor_m);
}

}  // namespace

Mesh make_truck(Random& random) {
  const double length = random.uniform(7.0, 10.8);
  const double front = 0.5 * length;
  const double half = random.uniform(1.20, 1.26);
  Cab cab = draw_cab(front - 0.012, random.uniform(1.65, 2.2), half - 0.06, random);
  cab.height_m = random.uniform(2.6, 3.2);
  LoadBody body;
  body.kind = draw_load_kind(random);
  body.x = {-front + 0.03, cab.front_x - cab.length_m - random.uniform(0.10, 0.35)};
  body.half_width_m = half;
  body.floor_m = 2.0 * cab.wheel.radius_m + random.uniform(0.10, 0.2);
  body.top_m = random.uniform(3.2, 3.8);
  Mesh mesh;
  add_cab(mesh, cab, random);
  add_load_body(mesh, body, random);
  const double rear_axle = -front + length * random.uniform(0.22, 0.27);
  std::vector<double> axles{rear_axle};
  if (length > 8.8 && random.chance(0.7)) axles = {rear_axle - 0.66, rear_axle + 0.66};
  add_rear_axles(mesh, axles, half, twin(cab.wheel));
  add_frame(mesh, {-front + 0.1, front - 0.6}, body.floor_m + 0.01);
  const Stretch between{axles.back() + 0.75, cab.axle_x - 0.8};
  add_tanks(mesh, {between.front - 1.0, between.front}, half, body.floor_m, random);
  add_side_guards(mesh, {between.rear, between.front - 1.3}, half);
  add_underrun_bar(mesh, -front, half, body.floor_m);
  settle(mesh);
  return mesh;
}

Mesh make_articulated_truck(Random& random) {
  constexpr double kLength = 16.5;
  constexpr double kFront = 0.5 * kLength;
  Mesh mesh;
  Cab cab = draw_cab(kFront - 0.012, random.uniform(2.0, 2.3), 1.22, random);
  cab.height_m = random.uniform(3.0, 3.85);
  add_cab(mesh, cab, random);
  add_semi_trailer(mesh, -kFront, 0.42, random);
  const double drive_axle = cab.axle_x - random.uniform(3.6, 3.8);
  add_rear_axles(mesh, {drive_axle}, 1.25, twin(cab.wheel));
  add_frame(mesh, {drive_axle - 0.8, kFront - 0.6}, 0.98);
  // The fifth wheel on which the trailer lies.
  add_block(mesh, {drive_axle - 0.2, -0.45, 0.97}, {drive_axle + 0.7, 0.45, 1.16}, Surface::kTrim);
  add_tanks(mesh, {drive_axle + 0.8, cab.axle_x - 0.85}, 1.22, 1.05, random);
  settle(mesh);
  return mesh;
}

Mesh make_parked_semi_trailer(Random& random) {
  Mesh mesh;
  add_semi_trailer(mesh, -6.8, 0.0, random);
  settle(mesh);
  return mesh;
}

}  // namespace stillmap::simulation
