#include "bodies/heavy_parts.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace stillmap::simulation {
namespace {

using Eigen::Vector3d;

constexpr double kFloorThickness = 0.14;

/// Strips of reflecting tape along the lower edge, as UN R104 wants them on heavy vehicles.
void add_contour_tape(Mesh& mesh, const LoadBody& body) {
  const double z = body.floor_m + 0.03;
  for (const double side : {1.0, -1.0}) {
    const double y = side * (body.half_width_m + 0.002);
    mesh.add_quad({body.x.rear + 0.1, y, z}, {body.x.front - 0.1, y, z},
                  {body.x.front - 0.1, y, z + 0.05}, {body.x.rear + 0.1, y, z + 0.05},
                  Surface::kReflector);
  }
}

void add_box_body(Mesh& mesh, const LoadBody& body, Random& random) {
  // Most are white, whatever the colour of the cab.
  const Material skin = random.chance(0.7) ? Material(Surface::kTarpaulin, 1.3) : Surface::kPaint;
  const double w = body.half_width_m;
  add_block(mesh, {body.x.rear + 0.02, -w + 0.01, body.floor_m + kFloorThickness},
            {body.x.front, w - 0.01, body.top_m - 0.01}, skin);
  // Frame of the rear doors, their bars, and the edges of the roof.
  for (const double y : {-w + 0.06, 0.0, w - 0.06})
    add_block(mesh, {body.x.rear, y - 0.05, body.floor_m},
              {body.x.rear + 0.05, y + 0.05, body.top_m}, Surface::kChrome);
  for (const double y : {-w + 0.03, w - 0.03})
    add_block(mesh, {body.x.rear, y - 0.03, body.top_m - 0.08},
              {body.x.front, y + 0.03, body.top_m}, Surface::kChrome);
  if (random.chance(0.35)) {
    add_block(mesh, {body.x.front, -0.8, body.top_m - 0.75},
              {body.x.front + 0.07, 0.8, body.top_m - 0.1}, Material(Surface::kTrim, 2.0));
  }
}

/// A sheet between the posts of a side: pressed outward between them, by less where it is tied.
void add_sheet(Mesh& mesh, const LoadBody& body, double side, double bulge_m, Material material) {
  const double low = body.floor_m + 0.06;
  const double height = body.top_m - 0.03 - low;
  const int bays = std::max(2, static_cast<int>(std::lround((body.x.front - body.x.rear) / 1.4)));
  const double step = (body.x.front - body.x.rear) / (2.0 * bays);
  constexpr std::array<double, 4> kRows{0.0, 0.35, 0.8, 1.0};
  constexpr std::array<double, 4> kBows{0.0, 1.0, 0.7, 0.0};
  const auto at = [&](int column, std::size_t row) {
    const double out = column % 2 == 1 ? bulge_m * kBows.at(row) : 0.0;
    return Vector3d(body.x.rear + column * step, side * (body.half_width_m - bulge_m + out),
                    low + kRows.at(row) * height);
  };
  for (int column = 0; column < 2 * bays; ++column)
    for (std::size_t row = 0; row + 1 < kRows.size(); ++row)
      mesh.add_quad(at(column, row), at(column + 1, row), at(column + 1, row + 1),
                    at(column, row + 1), material);
}

void add_tarpaulin_body(Mesh& mesh, const LoadBody& body, Random& random) {
  const Material sheet(Surface::kTarpaulin, random.uniform(0.25, 1.5));
  const double bulge = random.uniform(0.01, 0.04);
  const double w = body.half_width_m - bulge;
  for (const double side : {1.0, -1.0}) add_sheet(mesh, body, side, bulge, sheet);
  const double top = body.top_m - 0.03;
  mesh.add_quad({body.x.rear, -w, top}, {body.x.rear, 0.0, body.top_m},
                {body.x.front, 0.0, body.top_m}, {body.x.front, -w, top}, sheet);
  mesh.add_quad({body.x.rear, w, top}, {body.x.rear, 0.0, body.top_m},
                {body.x.front, 0.0, body.top_m}, {body.x.front, w, top}, sheet);
  add_block(mesh, {body.x.front - 0.04, -w, body.floor_m}, {body.x.front, w, body.top_m - 0.02},
            Surface::kTarpaulin);
  const Material doors = random.chance(0.5) ? sheet : Material(Surface::kTarpaulin, 1.2);
  add_block(mesh, {body.x.rear, -w, body.floor_m}, {body.x.rear + 0.05, w, body.top_m - 0.02},
            doors);
  for (const double y : {-0.35, -0.04, 0.04, 0.35})
    add_block(mesh, {body.x.rear - 0.03, y - 0.015, body.floor_m + 0.1},
              {body.x.rear, y + 0.015, body.top_m - 0.15}, Surface::kChrome);
}

/// Walls around a floor, `height_m` above it.
void add_walls(Mesh& mesh, const LoadBody& body, double height_m, Material material) {
  const double w = body.half_width_m;
  const double low = body.floor_m + 0.02;
  const double top = body.floor_m + kFloorThickness + height_m;
  for (const double y : {-w, w - 0.05})
    add_block(mesh, {body.x.rear, y, low}, {body.x.front, y + 0.05, top}, material);
  for (const double x : {body.x.rear, body.x.front - 0.05})
    add_block(mesh, {x, -w + 0.05, low}, {x + 0.05, w - 0.05, top}, material);
}

void add_tipper_body(Mesh& mesh, const LoadBody& body, Random& random) {
  const double wall = random.uniform(0.8, 1.4);
  LoadBody trough = body;
  trough.half_width_m -= 0.05;
  add_walls(mesh, trough, wall, Surface::kPaint);
  const double w = body.half_width_m;
  const double top = body.floor_m + kFloorThickness + wall;
  const int ribs = std::max(3, static_cast<int>((body.x.front - body.x.rear) / 0.8));
  for (int i = 0; i <= ribs; ++i) {
    const double x = body.x.rear + 0.05 + (body.x.front - body.x.rear - 0.1) * i / ribs;
    for (const double y : {-w, w - 0.05})
      add_block(mesh, {x - 0.04, y, body.floor_m}, {x + 0.04, y + 0.05, top + 0.02},
                Surface::kPaint);
  }
  if (random.chance(0.5)) {
    const double middle = 0.5 * (body.x.front + body.x.rear);
    add_ball(mesh, {middle, 0.0, top - 0.35},
             {0.5 * (body.x.front - body.x.rear) - 0.1, w - 0.15, random.uniform(0.3, 0.6)},
             Material(Surface::kInterior, random.uniform(1.0, 1.9)), 12);
  }
}

void add_flat_bed(Mesh& mesh, const LoadBody& body, Random& random) {
  const double wall = random.chance(0.7) ? random.uniform(0.35, 0.6) : 0.02;
  add_walls(mesh, body, wall, Material(Surface::kChrome, 0.8));
  const double floor = body.floor_m + kFloorThickness;
  add_block(mesh, {body.x.front - 0.06, -body.half_width_m + 0.02, floor},
            {body.x.front, body.half_width_m - 0.02, floor + random.uniform(0.9, 1.3)},
            Surface::kTrim);
  double x = body.x.rear + random.uniform(0.1, 1.0);
  while (x < body.x.front - 1.0) {
    const double length = std::min(random.uniform(0.8, 2.0), body.x.front - 0.2 - x);
    const double half = random.uniform(0.5, body.half_width_m - 0.1);
    if (random.chance(0.6))
      add_block(mesh, {x, -half, floor}, {x + length, half, floor + random.uniform(0.3, 1.2)},
                Material(Surface::kTarpaulin, random.uniform(0.3, 1.3)));
    x += length + random.uniform(0.02, 0.4);
  }
}

Hull cab_hull(const Cab& cab, Random& random) {
  Hull hull;
  const double rear = cab.front_x - cab.length_m;
  const double h = cab.height_m;
  hull.top = {{rear, h - 0.03},
              {cab.front_x - 0.7, h},
              {cab.front_x - 0.25, h - 0.06},
              {cab.front_x, h - 0.20}};
  const double belt = std::min(0.60 * h, 1.85);
  hull.belt = {{rear, belt}, {cab.front_x - 0.4, belt}, {cab.front_x, belt - 0.12}};
  hull.half_width_m = cab.half_width_m;
  hull.tumblehome = 0.06;
  hull.crown_m = 0.06;
  hull.clearance_m = random.uniform(0.30, 0.40);
  hull.bumper_height_m = 0.75;
  hull.well_m = cab.wheel.width_m + 0.10;
  hull.pane_top = std::clamp(0.85 / (h - belt), 0.5, 0.85);
  hull.arches.push_back({cab.axle_x, cab.wheel.radius_m + 0.09, cab.wheel.radius_m});
  hull.front = {0.45, 0.07, 0.10, random.uniform(0.12, 0.30), 0.04};
  hull.rear = {0.10, 0.02, 0.0, 0.0, 0.0};
  hull.cuts = {cab.front_x - 0.30, cab.front_x - 1.15};
  return hull;
}

HullMaterials cab_materials(const Cab& cab) {
  const Stretch door{cab.front_x - 1.15, cab.front_x - 0.30};
  HullMaterials materials;
  materials.side = [door](double x, int strip, double /*side*/) {
    if (strip <= kLowerSide) return Surface::kTrim;
    const bool pane = strip == kLowerPane || strip == kUpperPane;
    return pane && door.holds(x) ? Surface::kCarGlass : Surface::kPaint;
  };
  materials.front = [](double share, int strip) {
    if (strip == kLowerPane || strip == kUpperPane) return Surface::kCarGlass;
    if (strip == kLowerSide) return share > 0.7 ? Surface::kReflector : Surface::kTrim;
    return strip == kMiddleSide && share < 0.7 ? Surface::kTrim : Surface::kPaint;
  };
  materials.rear = [](double /*share*/, int strip) {
    return strip <= kLowerSide ? Surface::kTrim : Surface::kPaint;
  };
  return materials;
}

void add_cab_inside(Mesh& mesh, const Cab& cab, double belt, Random& random) {
  const double half = cab.half_width_m - 0.12;
  const double hip_x = cab.front_x - std::min(1.35, cab.length_m - 0.45);
  const double hip_z = belt - random.uniform(0.28, 0.36);
  for (const double side : {1.0, -1.0}) add_seat(mesh, {{hip_x, 0.62 * side, hip_z}, 0.55});
  add_block(mesh, {cab.front_x - 0.65, -half, belt - 0.45}, {cab.front_x - 0.34, half, belt - 0.05},
            Surface::kInterior);
  if (random.chance(0.5)) add_driver(mesh, {hip_x, 0.62, hip_z}, random);
}

}  // namespace

LoadKind draw_load_kind(Random& random) {
  constexpr std::array kKinds{LoadKind::kBox,       LoadKind::kBox,    LoadKind::kBox,
                              LoadKind::kTarpaulin, LoadKind::kTipper, LoadKind::kFlatBed};
  return kKinds.at(random.index(kKinds.size()));
}

void add_load_body(Mesh& mesh, const LoadBody& body, Random& random) {
  const double w = body.half_width_m - 0.03;
  add_block(mesh, {body.x.rear + 0.01, -w, body.floor_m},
            {body.x.front - 0.01, w, body.floor_m + kFloorThickness}, Surface::kTrim);
  switch (body.kind) {
    case LoadKind::kBox:
      add_box_body(mesh, body, random);
      break;
    case LoadKind::kTarpaulin:
      add_tarpaulin_body(mesh, body, random);
      break;
    case LoadKind::kTipper:
      add_tipper_body(mesh, body, random);
      break;
    case LoadKind::kFlatBed:
      add_flat_bed(mesh, body, random);
      break;
  }
  add_contour_tape(mesh, body);
}

void add_cab(Mesh& mesh, const Cab& cab, Random& random) {
  const Hull hull = cab_hull(cab, random);
  add_hull(mesh, hull, cab_materials(cab));
  add_axle(mesh, cab.axle_x, cab.half_width_m - 0.03, cab.wheel);
  add_plate(mesh, {cab.front_x, 0.0, 0.55});
  const double belt = hull.belt_at(cab.front_x - 0.5);
  add_mirrors(mesh, {cab.front_x - 0.22, cab.half_width_m - 0.02, belt + 0.15}, 0.08, {0.12, 0.55});
  add_cab_inside(mesh, cab, belt, random);
}

void add_frame(Mesh& mesh, const Stretch& x, double top_m) {
  for (const double y : {-0.45, 0.37})
    add_block(mesh, {x.rear, y, top_m - 0.27}, {x.front, y + 0.08, top_m}, Surface::kTrim);
}

void add_side_guards(Mesh& mesh, const Stretch& x, double half_width_m) {
  if (x.front - x.rear < 0.6) return;
  for (const double y : {-half_width_m + 0.02, half_width_m - 0.05}) {
    for (const double z : {0.50, 0.82})
      add_block(mesh, {x.rear, y, z}, {x.front, y + 0.03, z + 0.12}, Surface::kChrome);
    const int posts = std::max(1, static_cast<int>((x.front - x.rear) / 1.5));
    for (int i = 0; i <= posts; ++i) {
      const double at = x.rear + 0.05 + (x.front - x.rear - 0.1) * i / posts;
      const double inner = y > 0.0 ? y - 0.04 : y + 0.03;
      add_block(mesh, {at - 0.03, inner, 0.48}, {at + 0.03, inner + 0.04, 1.2}, Surface::kTrim);
    }
  }
}

void add_underrun_bar(Mesh& mesh, double x, double half_width_m, double floor_m) {
  const double w = half_width_m - 0.06;
  add_block(mesh, {x, -w, 0.45}, {x + 0.10, w, 0.58}, Surface::kTrim);
  for (const double y : {-0.45, 0.37})
    add_block(mesh, {x + 0.03, y, 0.5}, {x + 0.13, y + 0.08, floor_m + 0.02}, Surface::kTrim);
  for (const double y : {-w + 0.02, w - 0.42}) {
    add_block(mesh, {x + 0.01, y, 0.68}, {x + 0.08, y + 0.40, 0.82}, Surface::kReflector);
    add_block(mesh, {x + 0.03, y + 0.15, 0.56}, {x + 0.06, y + 0.25, 0.70}, Surface::kTrim);
  }
  add_block(mesh, {x + 0.04, -0.40, 0.70}, {x + 0.07, 0.40, 0.86}, Surface::kTrim);
  add_plate(mesh, {x + 0.03, 0.0, 0.78});
}

void add_rear_axles(Mesh& mesh, const std::vector<double>& xs, double half_width_m,
                    const Wheel& wheel) {
  const double r = wheel.radius_m;
  for (const double x : xs) {
    add_axle(mesh, x, half_width_m - 0.03, wheel);
    mesh.add_column({x, -half_width_m + 0.1, r}, {0.0, 2.0 * half_width_m - 0.2, 0.0}, {0.09, 0.09},
                    Surface::kTrim, 6);
    for (const double side : {1.0, -1.0}) {
      const double outer = side * (half_width_m - 0.04);
      const double inner = side * (half_width_m - 0.04 - wheel.width_m);
      add_block(mesh, {x - 0.9 * r, std::min(inner, outer), 2.0 * r + 0.04},
                {x + 0.9 * r, std::max(inner, outer), 2.0 * r + 0.07}, Surface::kTrim);
    }
  }
}

}  // namespace stillmap::simulation
