#include <algorithm>
#include <vector>

#include "bodies/heavy_vehicle_bodies.hpp"
#include "bodies/vehicle_parts.hpp"

namespace stillmap::simulation {
namespace {

using Eigen::Vector3d;

/// A bus: x from the middle of its length [m].
struct Bus {
  double length, half_width, height;
  double front_axle, rear_axle;
  Wheel wheel;
  std::vector<Stretch> windows;
  std::vector<Stretch> door_leaves;
  Hull hull;
};

Bus draw_bus(Random& random) {
  Bus bus;
  bus.length = random.uniform(11.6, 12.3);
  bus.half_width = random.uniform(1.25, 1.275);
  bus.height = random.uniform(2.9, 3.25);
  bus.wheel = {.radius_m = random.uniform(0.47, 0.50), .width_m = 0.30, .rim_radius_m = 0.29};
  bus.front_axle = 0.5 * bus.length - random.uniform(2.6, 2.8);
  bus.rear_axle = bus.front_axle - random.uniform(5.8, 6.0);
  return bus;
}

/// Windows between pillars, and on the right side doors of two leaves: one before the front axle,
/// one between the axles, and by chance one behind the rear axle.
void draw_openings(Bus& bus, Random& random) {
  const double front = 0.5 * bus.length;
  const double pitch = random.uniform(1.35, 1.75);
  const double pillar = random.uniform(0.05, 0.10);
  for (double x = front - 0.45; x - 0.9 > -front + 0.3; x -= pitch)
    bus.windows.push_back({std::max(x - pitch + pillar, -front + 0.3), x});
  std::vector<double> doors{front - 1.15, 0.5 * (bus.front_axle + bus.rear_axle) + 0.3};
  if (random.chance(0.5)) doors.push_back(bus.rear_axle - 1.5);
  for (const double x : doors) {
    bus.door_leaves.push_back({x - 0.62, x - 0.03});
    bus.door_leaves.push_back({x + 0.03, x + 0.62});
  }
}

void shape_hull(Bus& bus, Random& random) {
  const double front = 0.5 * bus.length;
  const double h = bus.height;
  Hull& hull = bus.hull;
  const double pod = random.chance(0.6) ? 0.0 : 0.12;  // flat roof, or one that rises to the rear
  hull.top = {{-front, h - 0.12},     {-front + 0.25, h - 0.02},     {0.0, h},
              {front - 1.0, h - pod}, {front - 0.3, h - pod - 0.04}, {front, h - pod - 0.18}};
  const double belt = random.uniform(1.02, 1.18);
  hull.belt = {
      {-front, belt + 0.25}, {-front + 0.3, belt}, {front - 0.5, belt}, {front, belt + 0.05}};
  hull.half_width_m = bus.half_width;
  hull.tumblehome = 0.04;
  hull.crown_m = 0.08;
  hull.clearance_m = random.uniform(0.25, 0.30);
  hull.bumper_height_m = 0.55;
  hull.well_m = bus.wheel.width_m + 0.30;
  hull.pane_top = random.uniform(0.72, 0.80);
  for (const double x : {bus.front_axle, bus.rear_axle})
    hull.arches.push_back({x, bus.wheel.radius_m + 0.08, bus.wheel.radius_m});
  hull.front = {0.50, 0.08, random.uniform(0.12, 0.22), random.uniform(0.10, 0.22), 0.04};
  hull.rear = {0.30, 0.05, 0.08, 0.06, 0.04};
  for (const auto* stretches : {&bus.windows, &bus.door_leaves})
    for (const Stretch& stretch : *stretches) {
      hull.cuts.push_back(stretch.rear);
      hull.cuts.push_back(stretch.front);
    }
}

HullMaterials draw_materials(const Bus& bus, Random& random) {
  const bool dark_pillars = random.chance(0.6);
  HullMaterials materials;
  materials.side = [bus, dark_pillars](double x, int strip, double side) {
    if (strip <= kWellRoof) return Surface::kTrim;
    const bool pane = strip == kLowerPane || strip == kUpperPane;
    const bool doorway = any_holds(bus.door_leaves, x) && side < 0.0;
    if (doorway && strip > kLowerSide && strip <= kUpperPane) return Surface::kCarGlass;
    if (pane && any_holds(bus.windows, x)) return Surface::kCarGlass;
    return pane && dark_pillars ? Surface::kTrim : Surface::kPaint;
  };
  materials.front = [](double share, int strip) {
    if (strip == kShoulder || strip == kLowerPane || strip == kUpperPane) return Surface::kCarGlass;
    // Where the line's number shines behind dark glass.
    if (strip == kPaneFrame) return Surface::kTrim;
    return strip == kLowerSide && share > 0.7 ? Surface::kReflector : Surface::kPaint;
  };
  materials.rear = [](double share, int strip) {
    if (strip == kMiddleSide && share > 0.7) return Surface::kReflector;
    if (strip == kMiddleSide) return Surface::kTrim;  // grille of the engine
    return strip == kUpperPane && share < 0.7 ? Surface::kCarGlass : Surface::kPaint;
  };
  return materials;
}

/// Benches on both sides, none at the doors; behind the rear axle they stand higher.
void add_seats(Mesh& mesh, const Bus& bus, Random& random) {
  const double front = 0.5 * bus.length;
  const double pitch = random.uniform(0.78, 0.95);
  for (double x = front - 2.9; x > -front + 0.9; x -= pitch) {
    const double hip_z = x < bus.rear_axle + 1.0 ? 1.15 : 0.85;
    for (const double side : {1.0, -1.0}) {
      const bool at_door = std::any_of(
          bus.door_leaves.begin(), bus.door_leaves.end(),
          [&](const Stretch& leaf) { return x + 0.5 > leaf.rear && x - 0.3 < leaf.front; });
      if (at_door && side < 0.0) continue;
      add_seat(mesh, {{x, 0.72 * side, hip_z}, 0.85, 0.42, 0.62, 0});
    }
  }
}

void add_inside(Mesh& mesh, const Bus& bus, Random& random) {
  const double front = 0.5 * bus.length;
  const double half = bus.half_width - 0.12;
  add_seats(mesh, bus, random);
  add_block(mesh, {-front + 0.3, -half, 0.34}, {bus.rear_axle - 0.6, half, 0.68},
            Surface::kInterior);
  // Driver's place: on the left, with a wall behind it and a dashboard ahead of it.
  const Vector3d hip(front - 1.45, 0.55, 1.0);
  add_seat(mesh, {hip, 0.52});
  add_block(mesh, {front - 0.65, -0.1, 0.55}, {front - 0.42, half - 0.1, 1.05}, Surface::kInterior);
  add_block(mesh, {front - 1.95, 0.15, 0.4}, {front - 1.91, half, 1.7}, Surface::kInterior);
  if (random.chance(0.7)) add_driver(mesh, hip, random);
  for (const double x : {front - 2.2, 0.8, bus.rear_axle + 0.3})
    mesh.add_column({x, -0.35, 0.32}, {0.0, 0.0, bus.height - 0.5}, {0.02, 0.02}, Surface::kChrome,
                    5);
}

void add_outside(Mesh& mesh, const Bus& bus, Random& random) {
  const double front = 0.5 * bus.length;
  add_plate(mesh, {front, 0.0, 0.45});
  add_plate(mesh, {-front, 0.0, 0.62});
  add_mirrors(mesh, {front - 0.25, bus.half_width - 0.08, bus.hull.belt_at(front) + 0.45}, 0.13,
              {0.12, 0.38});
  // Cooling, or tanks for gas, on the roof.
  const double length = random.uniform(1.2, 3.5);
  const double x = random.uniform(-front + 0.6, -0.5);
  if (random.chance(0.7))
    add_block(mesh, {x, -0.75, bus.height - 0.1}, {x + length, 0.75, bus.height + 0.16},
              Surface::kPaint);
}

}  // namespace

Mesh make_bus(Random& random) {
  Bus bus = draw_bus(random);
  draw_openings(bus, random);
  shape_hull(bus, random);
  Mesh mesh;
  add_hull(mesh, bus.hull, draw_materials(bus, random));
  add_axle(mesh, bus.front_axle, bus.half_width - 0.03, bus.wheel);
  Wheel rear = bus.wheel;
  rear.width_m = 0.56;
  add_axle(mesh, bus.rear_axle, bus.half_width - 0.03, rear);
  add_outside(mesh, bus, random);
  add_inside(mesh, bus, random);
  settle(mesh);
  return mesh;
}

}  // namespace stillmap::simulation
