#include <algorithm>

#include "bodies/heavy_vehicle_bodies.hpp"
#include "bodies/vehicle_parts.hpp"

namespace stillmap::simulation {
namespace {

using Eigen::Vector3d;

/// From the coupling at (x, 0) to both corners of a frame, with a jockey wheel.
void add_drawbar(Mesh& mesh, double coupling_x, double frame_x, double spread_m, double height_m) {
  for (const double side : {1.0, -1.0})
    add_limb(mesh,
             {{{coupling_x - 0.25, 0.0, height_m}, 0.035},
              {{frame_x, side * spread_m, height_m}, 0.035}},
             Surface::kChrome, 5);
  add_limb(mesh, {{{coupling_x - 0.27, 0.0, height_m}, 0.04}, {{coupling_x, 0.0, height_m}, 0.045}},
           Surface::kTrim, 6);
  const double x = coupling_x - 0.45;
  add_limb(mesh, {{{x, 0.12, 0.18}, 0.025}, {{x, 0.12, height_m + 0.3}, 0.025}}, Surface::kChrome,
           6);
  add_wheel(mesh, {x, 0.145, 0.10}, 1.0, {.radius_m = 0.10, .width_m = 0.05, .rim_radius_m = 0.06});
}

void add_mudguard(Mesh& mesh, double x, double side, double inner, double outer, double radius_m) {
  const double low = std::min(side * inner, side * outer);
  const double high = std::max(side * inner, side * outer);
  const double top = 2.0 * radius_m + 0.06;
  add_block(mesh, {x - 0.6 * radius_m, low, top - 0.02}, {x + 0.6 * radius_m, high, top},
            Surface::kTrim);
  for (const double way : {1.0, -1.0}) {
    const double a = x + way * 0.6 * radius_m;
    const double b = x + way * 1.25 * radius_m;
    mesh.add_quad({a, low, top - 0.01}, {a, high, top - 0.01}, {b, high, 1.3 * radius_m},
                  {b, low, 1.3 * radius_m}, Surface::kTrim);
  }
}

/// An open box of sheet metal or wood; by chance with a cover over a frame.
void add_tub(Mesh& mesh, double rear_x, double front_x, double half, Random& random) {
  const double floor = random.uniform(0.42, 0.60);
  const double wall = floor + random.uniform(0.30, 0.45);
  const Material skin =
      random.chance(0.6) ? Material(Surface::kChrome) : Material(Surface::kTrim, 2.0);
  add_block(mesh, {rear_x, -half, floor - 0.06}, {front_x, half, floor}, Surface::kTrim);
  for (const double y : {-half, half - 0.03})
    add_block(mesh, {rear_x, y, floor}, {front_x, y + 0.03, wall}, skin);
  for (const double x : {rear_x, front_x - 0.03})
    add_block(mesh, {x, -half + 0.03, floor}, {x + 0.03, half - 0.03, wall}, skin);
  const double kind = random.uniform();
  if (kind < 0.4) {
    const double top = wall + random.uniform(0.05, 0.85);
    const double slope = top - wall > 0.4 ? 0.06 : 0.0;
    const Material sheet(Surface::kTarpaulin, random.uniform(0.3, 1.2));
    add_tube(mesh,
             {{{rear_x, 0.0, 0.5 * (wall + top) - 0.02},
               {0.0, half, 0.5 * (top - wall) + 0.05},
               {0.0, -half, 0.5 * (top - wall) + 0.05}},
              {{front_x - slope, 0.0, 0.5 * (wall + top) - 0.02},
               {0.0, half, 0.5 * (top - wall) + 0.05},
               {0.0, -half, 0.5 * (top - wall) + 0.05}}},
             sheet, 4);
  } else if (kind < 0.6) {
    add_ball(mesh, {0.5 * (rear_x + front_x), 0.0, wall - 0.1},
             {0.5 * (front_x - rear_x) - 0.06, half - 0.06, random.uniform(0.15, 0.35)},
             Material(Surface::kInterior, 1.5), 10);
  }
}

Mesh make_small_trailer(Random& random) {
  const double box = random.uniform(1.8, 2.6);
  const double half = random.uniform(0.50, 0.68);
  const double radius = random.uniform(0.25, 0.30);
  const Wheel wheel{.radius_m = radius, .width_m = 0.15, .rim_radius_m = 0.6 * radius};
  Mesh mesh;
  add_tub(mesh, -0.5 * box, 0.5 * box, half, random);
  const double axle = -random.uniform(0.02, 0.15);
  const double outer = half + 0.03 + wheel.width_m;
  add_axle(mesh, axle, outer, wheel);
  mesh.add_column({axle, -half - 0.05, radius}, {0.0, 2.0 * half + 0.1, 0.0}, {0.03, 0.03},
                  Surface::kTrim, 6);
  for (const double side : {1.0, -1.0}) {
    add_mudguard(mesh, axle, side, half - 0.01, outer + 0.01, radius);
    add_block(mesh, {-0.5 * box - 0.05, side > 0.0 ? half - 0.3 : -half, 0.40},
              {-0.5 * box, side > 0.0 ? half : -half + 0.3, 0.52}, Surface::kReflector);
  }
  add_plate(mesh, {-0.5 * box - 0.02, 0.0, 0.46});
  add_drawbar(mesh, 0.5 * box + random.uniform(0.9, 1.2), 0.5 * box - 0.1, 0.7 * half, 0.42);
  settle(mesh);
  return mesh;
}

Hull caravan_hull(double length, double axle, const Wheel& wheel, Random& random) {
  const double front = 0.5 * length;
  const double h = random.uniform(2.50, 2.62);
  Hull hull;
  hull.top = {
      {-front, h - 0.25},      {-front + 0.25, h - 0.05}, {0.0, h},
      {front - 0.9, h - 0.04}, {front - 0.35, h - 0.25},  {front, h - random.uniform(0.6, 0.9)}};
  hull.belt = {{-front, 1.30}, {front - 0.8, 1.30}, {front, 1.15}};
  hull.half_width_m = 0.5 * random.uniform(2.12, 2.45);
  hull.tumblehome = 0.02;
  hull.crown_m = 0.05;
  hull.clearance_m = random.uniform(0.30, 0.36);
  hull.bumper_height_m = 0.60;
  hull.well_m = wheel.width_m + 0.10;
  hull.pane_top = 0.62;
  hull.arches.push_back({axle, wheel.radius_m + 0.06, wheel.radius_m});
  hull.front = {0.5, 0.06, 0.05, random.uniform(0.15, 0.35), 0.03};
  hull.rear = {0.4, 0.04, 0.04, 0.10, 0.02};
  return hull;
}

Mesh make_caravan(Random& random) {
  const double length = random.uniform(4.3, 6.4);
  const double front = 0.5 * length;
  const double axle = -random.uniform(0.05, 0.25);
  const Wheel wheel{.radius_m = 0.32, .width_m = 0.19, .rim_radius_m = 0.20};
  Hull hull = caravan_hull(length, axle, wheel, random);
  const std::vector<Stretch> windows{{-front + 0.45, -front + 1.35}, {front - 1.6, front - 0.7}};
  for (const Stretch& window : windows)
    for (const double x : {window.rear, window.front}) hull.cuts.push_back(x);
  HullMaterials materials;
  materials.side = [windows](double x, int strip, double /*side*/) {
    if (strip <= kWellRoof) return Surface::kTrim;
    const bool pane = strip == kLowerPane || strip == kUpperPane;
    return pane && any_holds(windows, x) ? Surface::kCarGlass : Surface::kPaint;
  };
  materials.front = materials.rear = [](double share, int strip) {
    const bool pane = strip == kLowerPane || strip == kUpperPane;
    if (pane && share < 0.7) return Surface::kCarGlass;
    return strip == kLowerSide && share > 0.7 ? Surface::kReflector : Surface::kPaint;
  };
  Mesh mesh;
  add_hull(mesh, hull, materials);
  add_axle(mesh, axle, hull.half_width_m - 0.03, wheel);
  const double half = hull.half_width_m - 0.15;
  for (const double x : {-front + 0.3, front - 1.5})
    add_block(mesh, {x, -half, 0.5}, {x + 1.0, half, 1.25}, Surface::kInterior);
  add_block(mesh, {-0.6, -half, 0.5}, {0.5, -half + 0.5, 2.1}, Surface::kInterior);
  add_plate(mesh, {-front, 0.0, 0.62});
  add_drawbar(mesh, front + random.uniform(1.1, 1.3), front - 0.3, 0.6, 0.43);
  settle(mesh);
  return mesh;
}

}  // namespace

Mesh make_trailer(Random& random) {
  const double kind = random.uniform();
  if (kind < 0.45) return make_small_trailer(random);
  if (kind < 0.75) return make_caravan(random);
  return make_parked_semi_trailer(random);
}

}  // namespace stillmap::simulation
