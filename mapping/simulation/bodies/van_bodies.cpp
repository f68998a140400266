#include <algorithm>
#include <cmath>

#include "bodies/vehicle_bodies.hpp"
#include "bodies/vehicle_parts.hpp"

namespace stillmap::simulation {
namespace {

using Eigen::Vector2d;

/// One van: x from the middle of its length [m].
struct Van {
  double length, half_width, height;
  double front_axle, rear_axle;
  Wheel wheel;
  double cowl_x, header_x;
  bool windows;
  std::vector<Stretch> panes;
  Hull hull;
};

Van draw_van(Random& random) {
  // About the mean of the vans labelled in KITTI: 5.1 m x 1.9 m x 2.2 m, mirrors with it.
  constexpr Spread kLength{5.10, 0.45, 4.30, 6.20};
  constexpr Spread kWidth{1.83, 0.06, 1.68, 1.98};
  constexpr Spread kHeight{2.12, 0.17, 1.82, 2.65};
  Van van;
  van.length = draw(kLength, random);
  van.half_width = 0.5 * (draw(kWidth, random) + 0.06 * (van.length - kLength.mean));
  // Long vans have high roofs.
  van.height = std::clamp(draw(kHeight, random) + 0.2 * (van.length - kLength.mean), 1.8, 2.75);
  van.wheel = {.radius_m = random.uniform(0.31, 0.35),
               .width_m = random.uniform(0.19, 0.23),
               .rim_radius_m = random.uniform(0.19, 0.22)};
  const double front = 0.5 * van.length;
  van.front_axle = front - random.uniform(0.86, 0.98);
  van.rear_axle = -front + van.length * random.uniform(0.175, 0.215);
  van.windows = random.chance(0.4);
  return van;
}

void draw_top(Van& van, Random& random) {
  const double front = 0.5 * van.length;
  const double h = van.height;
  const double nose = random.uniform(0.95, 1.08);
  const double cowl = random.uniform(1.18, 1.28);
  van.cowl_x = front - random.uniform(0.62, 0.85);
  van.header_x = van.cowl_x - (std::min(h, 2.15) - cowl) / std::tan(random.uniform(0.75, 0.95));
  const double header_z = std::min(h - 0.06, 2.12);
  std::vector<Vector2d>& top = van.hull.top;
  top = {{-front, h - random.uniform(0.12, 0.25)}};
  append_arc(top, {-front + 0.12, h - 0.05}, 0.02, 2);
  append_arc(top, {van.header_x - 0.5, h - 0.015}, 0.02, 3);
  append_arc(top, {van.header_x, header_z}, 0.02, 2);
  append_arc(top, {van.cowl_x, cowl}, 0.03, 2);
  append_arc(top, {front - 0.12, nose}, 0.04, 2);
  top.emplace_back(front, nose - random.uniform(0.08, 0.16));
  const double belt = cowl - random.uniform(0.08, 0.14);
  van.hull.belt = {
      {-front, belt}, {van.cowl_x, belt}, {front - 0.3, nose - 0.06}, {front, nose - 0.2}};
}

void draw_panes(Van& van, Random& random) {
  const double front = 0.5 * van.length;
  const double door_rear = van.front_axle - random.uniform(0.85, 1.0);
  van.panes = {{door_rear, van.cowl_x - 0.22}};
  const double rear = -front + 0.25;
  if (van.windows) {
    const double half = 0.5 * (door_rear - rear);
    van.panes.push_back({rear + half + 0.08, door_rear - 0.12});
    van.panes.push_back({rear, rear + half - 0.02});
  }
  for (const Stretch& pane : van.panes)
    for (const double x : {pane.rear, pane.front}) van.hull.cuts.push_back(x);
}

void shape_hull(Van& van, Random& random) {
  Hull& hull = van.hull;
  hull.half_width_m = van.half_width;
  hull.tumblehome = random.uniform(0.08, 0.15);
  hull.crown_m = random.uniform(0.05, 0.08);
  hull.clearance_m = random.uniform(0.18, 0.23);
  hull.bumper_height_m = random.uniform(0.48, 0.56);
  hull.well_m = van.wheel.width_m + 0.06;
  hull.pane_top = std::clamp(0.62 / (van.height - hull.belt.front().y()), 0.45, 0.85);
  const double arch = van.wheel.radius_m + random.uniform(0.04, 0.07);
  for (const double x : {van.front_axle, van.rear_axle})
    hull.arches.push_back({x, arch, van.wheel.radius_m});
  hull.front = {0.50, random.uniform(0.06, 0.10), random.uniform(0.10, 0.18),
                random.uniform(0.10, 0.20), random.uniform(0.03, 0.07)};
  hull.rear = {0.20, 0.03, random.uniform(0.02, 0.05), random.uniform(0.03, 0.12), 0.03};
}

HullMaterials draw_materials(const Van& van, Random& random) {
  const bool clad = random.chance(0.5);
  const bool rear_pane = van.windows || random.chance(0.5);
  HullMaterials materials;
  materials.side = [van, clad](double x, int strip, double /*side*/) {
    if (strip <= kWellRoof || (clad && strip == kLowerSide)) return Surface::kTrim;
    const bool pane = strip == kLowerPane || strip == kUpperPane;
    if (pane && any_holds(van.panes, x)) return Surface::kCarGlass;
    const bool screen = Stretch{van.header_x, van.cowl_x}.holds(x);
    return strip >= kOuterRoof && screen ? Surface::kCarGlass : Surface::kPaint;
  };
  materials.front = [clad](double share, int strip) {
    if (strip == kShoulder && share > 0.7) return Surface::kReflector;
    if (strip == kShoulder || (strip == kMiddleSide && share < 0.3)) return Surface::kTrim;
    return strip == kLowerSide && clad ? Surface::kTrim : Surface::kPaint;
  };
  materials.rear = [clad, rear_pane](double share, int strip) {
    if ((strip == kShoulder || strip == kMiddleSide) && share > 0.7) return Surface::kReflector;
    const bool pane = strip == kLowerPane || strip == kUpperPane;
    if (pane && rear_pane && share > 0.2 && share < 0.7) return Surface::kCarGlass;
    return strip == kLowerSide && clad ? Surface::kTrim : Surface::kPaint;
  };
  return materials;
}

void add_cabin(Mesh& mesh, const Van& van, Random& random) {
  const double half = van.half_width - 0.14;
  const double belt = van.hull.belt_at(van.cowl_x);
  const double hip_x = van.cowl_x - random.uniform(1.05, 1.15);
  const double hip_z = belt - random.uniform(0.32, 0.38);
  for (const double side : {1.0, -1.0})
    add_seat(mesh, {{hip_x, 0.5 * half * side, hip_z}, 0.85 * half});
  add_block(mesh, {van.cowl_x - 0.45, -half, belt - 0.35}, {van.cowl_x - 0.12, half, belt - 0.04},
            Surface::kInterior);
  if (van.windows) {
    for (double x = hip_x - 0.95; x > -0.5 * van.length + 0.5; x -= 0.95)
      add_seat(mesh, {{x, 0.0, hip_z}, 1.9 * half, 0.46, 0.56, 3});
  } else {
    // The wall to the goods.
    add_block(mesh, {hip_x - 0.38, -half, 0.4}, {hip_x - 0.36, half, van.height - 0.12},
              Surface::kInterior);
  }
  if (random.chance(0.4)) add_driver(mesh, {hip_x, 0.5 * half, hip_z}, random);
}

void add_outside(Mesh& mesh, const Van& van, Random& random) {
  const double front = 0.5 * van.length;
  add_plate(mesh, {front, 0.0, random.uniform(0.42, 0.52)});
  add_plate(mesh, {-front + 0.01, 0.0, random.uniform(0.55, 0.75)});
  const double x = van.cowl_x - random.uniform(0.32, 0.42);
  add_mirrors(mesh, {x, van.half_width - 0.03, van.hull.belt_at(x) + 0.03},
              random.uniform(0.06, 0.085), {0.11, 0.24});
  if (!random.chance(0.15)) return;
  // A ladder rack.
  const double y = 0.7 * van.half_width;
  for (const double at : {0.6 * -front, 0.0, van.header_x - 0.4}) {
    add_limb(mesh,
             {{{at, -y, van.height - 0.06}, 0.02},
              {{at, -y, van.height + 0.08}, 0.02},
              {{at, y, van.height + 0.08}, 0.02},
              {{at, y, van.height - 0.06}, 0.02}},
             Surface::kChrome, 5);
  }
}

}  // namespace

Mesh make_van(Random& random) {
  Van van = draw_van(random);
  draw_top(van, random);
  draw_panes(van, random);
  shape_hull(van, random);
  Mesh mesh;
  add_hull(mesh, van.hull, draw_materials(van, random));
  for (const double x : {van.front_axle, van.rear_axle})
    add_axle(mesh, x, van.half_width - 0.025, van.wheel);
  add_outside(mesh, van, random);
  add_cabin(mesh, van, random);
  settle(mesh);
  return mesh;
}

}  // namespace stillmap::simulation
