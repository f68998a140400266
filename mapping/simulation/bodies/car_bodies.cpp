#include <algorithm>
#include <cmath>

#include "bodies/vehicle_bodies.hpp"
#include "bodies/vehicle_parts.hpp"

namespace stillmap::simulation {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

/// What cars of a kind share: lengths [m], and proportions as shares of length or height.
struct CarFamily {
  Spread length, width, height;
  Spread clearance, wheel_radius;
  Spread bonnet;       // of the length, from the front edge to the foot of the windscreen
  Spread nose_height;  // of the height
  Spread rake_rad;     // of the windscreen against the ground
  Spread tail;         // [m], from the rear end to the rear edge of the roof
  Spread deck;         // [m], from the rear end to the foot of the rear window
};

// Means are such that small cars, saloons, estates and off-roaders mixed 3:3:3:2 have about the
// mean length, height and (mirrors added) width of the cars labelled in KITTI: 3.9 m, 1.53 m, 1.63
// m (Geiger, Lenz, Urtasun, CVPR 2012). All are therefore somewhat shorter than those of today.
constexpr CarFamily kSmall{{3.60, 0.25, 2.70, 4.20},   {1.56, 0.05, 1.46, 1.72},
                           {1.49, 0.06, 1.38, 1.66},   {0.160, 0.015, 0.13, 0.19},
                           {0.295, 0.012, 0.27, 0.32}, {0.225, 0.015, 0.18, 0.26},
                           {0.47, 0.02, 0.43, 0.52},   {0.58, 0.06, 0.47, 0.72},
                           {0.40, 0.08, 0.25, 0.58},   {0.08, 0.02, 0.04, 0.12}};
constexpr CarFamily kThreeBox{{4.15, 0.24, 3.70, 4.90},   {1.62, 0.05, 1.52, 1.78},
                              {1.43, 0.03, 1.35, 1.52},   {0.150, 0.015, 0.12, 0.18},
                              {0.305, 0.012, 0.28, 0.33}, {0.260, 0.012, 0.23, 0.29},
                              {0.475, 0.015, 0.44, 0.51}, {0.51, 0.03, 0.44, 0.58},
                              {1.12, 0.10, 0.90, 1.35},   {0.55, 0.06, 0.42, 0.70}};
constexpr CarFamily kLongRoof{{4.18, 0.22, 3.70, 4.90},   {1.62, 0.05, 1.52, 1.78},
                              {1.48, 0.04, 1.40, 1.60},   {0.155, 0.015, 0.12, 0.19},
                              {0.305, 0.012, 0.28, 0.33}, {0.250, 0.012, 0.22, 0.28},
                              {0.47, 0.015, 0.44, 0.51},  {0.52, 0.03, 0.45, 0.60},
                              {0.36, 0.06, 0.22, 0.50},   {0.06, 0.02, 0.03, 0.10}};
constexpr CarFamily kOffRoad{{4.05, 0.25, 3.60, 4.85},   {1.68, 0.06, 1.56, 1.86},
                             {1.67, 0.07, 1.54, 1.86},   {0.215, 0.02, 0.18, 0.26},
                             {0.350, 0.015, 0.32, 0.39}, {0.240, 0.015, 0.21, 0.27},
                             {0.52, 0.02, 0.48, 0.58},   {0.60, 0.06, 0.50, 0.75},
                             {0.36, 0.08, 0.18, 0.52},   {0.07, 0.02, 0.03, 0.12}};

const CarFamily& family_of(BodyKind kind) {
  switch (kind) {
    case BodyKind::kSaloon:
      return kThreeBox;
    case BodyKind::kEstate:
      return kLongRoof;
    case BodyKind::kSuv:
      return kOffRoad;
    default:
      return kSmall;
  }
}

/// One car: x from the middle of its length [m].
struct Car {
  BodyKind kind;
  double length, half_width, height;
  double front_axle, rear_axle;
  Wheel wheel;
  double cowl_x, header_x;
  double rear_header_x, deck_x;
  std::vector<Stretch> panes;
  Hull hull;
};

Car draw_car(BodyKind kind, Random& random) {
  const CarFamily& family = family_of(kind);
  Car car;
  car.kind = kind;
  car.length = draw(family.length, random);
  // Longer cars are wider: 10 cm per metre.
  const double width = draw(family.width, random) + 0.10 * (car.length - family.length.mean);
  car.half_width = 0.5 * width;
  car.height = draw(family.height, random);
  car.wheel.radius_m = draw(family.wheel_radius, random);
  car.wheel.rim_radius_m = car.wheel.radius_m * random.uniform(0.64, 0.72);
  car.wheel.width_m = random.uniform(0.17, 0.22);
  car.wheel.spokes = random.chance(0.6);
  car.hull.clearance_m = draw(family.clearance, random);
  const double front = 0.5 * car.length;
  car.front_axle = front - car.length * random.uniform(0.185, 0.205);
  car.rear_axle = car.front_axle - car.length * random.uniform(0.595, 0.635);
  return car;
}

/// Line over the middle of the car, from the rear end to the front end.
void draw_top(Car& car, Random& random) {
  const CarFamily& family = family_of(car.kind);
  const double h = car.height;
  const double front = 0.5 * car.length;
  const double nose = h * draw(family.nose_height, random);
  const double cowl = h * random.uniform(0.625, 0.665);
  const double roof_drop = random.uniform(0.03, 0.06);
  const double rear_drop = random.uniform(0.04, car.kind == BodyKind::kSaloon ? 0.10 : 0.07);
  car.cowl_x = front - car.length * draw(family.bonnet, random);
  car.header_x = car.cowl_x - (h - roof_drop - cowl) / std::tan(draw(family.rake_rad, random));
  car.rear_header_x = -front + draw(family.tail, random);
  car.deck_x = -front + draw(family.deck, random);
  const double deck =
      h * (car.kind == BodyKind::kSaloon ? random.uniform(0.66, 0.71) : random.uniform(0.62, 0.68));
  std::vector<Vector2d>& top = car.hull.top;
  top = {{-front, deck - random.uniform(0.02, 0.06)}};
  append_arc(top, {car.deck_x, deck}, 0.005, car.kind == BodyKind::kSaloon ? 2 : 1);
  append_arc(top, {car.rear_header_x, h - rear_drop}, 0.03, 2);
  append_arc(top, {car.header_x, h - roof_drop}, 0.5 * (roof_drop + rear_drop), 4);
  append_arc(top, {car.cowl_x, cowl}, 0.025, 2);
  append_arc(top, {front - 0.10, nose}, random.uniform(0.02, 0.05), 3);
  top.emplace_back(front, nose - random.uniform(0.03, 0.07));
}

void draw_belt(Car& car, Random& random) {
  const double front = 0.5 * car.length;
  const double cowl_belt = car.hull.top_at(car.cowl_x) - random.uniform(0.05, 0.09);
  const double rise = random.uniform(0.0, 0.07);
  const double nose = car.hull.top_at(front);
  car.hull.belt = {{-front, cowl_belt + rise},
                   {car.cowl_x, cowl_belt},
                   {front - 0.3, nose - 0.04},
                   {front, nose - 0.12}};
}

/// Panes of the doors and behind them, with pillars in between.
void draw_panes(Car& car, Random& random) {
  const double pillar = random.uniform(0.06, 0.11);
  const double middle = 0.5 * (car.front_axle + car.rear_axle) - random.uniform(0.05, 0.2);
  const double rear_edge = car.rear_header_x + (car.kind == BodyKind::kSaloon ? 0.02 : 0.12);
  const double door_edge = std::max(car.rear_axle + 0.05, rear_edge + 0.05);
  car.panes = {{middle + pillar, car.cowl_x - 0.12}, {door_edge, middle}};
  const bool third = door_edge - pillar - rear_edge > 0.2 && random.chance(0.85);
  if (third) car.panes.push_back({rear_edge, door_edge - pillar});
}

void shape_hull(Car& car, Random& random) {
  Hull& hull = car.hull;
  hull.half_width_m = car.half_width;
  hull.tumblehome = random.uniform(0.24, 0.40);
  hull.crown_m = random.uniform(0.045, 0.075);
  hull.well_m = car.wheel.width_m + 0.06;
  hull.bumper_height_m = random.uniform(0.46, 0.54);
  const double arch = car.wheel.radius_m + random.uniform(0.035, 0.065);
  for (const double x : {car.front_axle, car.rear_axle})
    hull.arches.push_back({x, arch, car.wheel.radius_m});
  hull.front = {0.60, random.uniform(0.06, 0.12), random.uniform(0.10, 0.20),
                random.uniform(0.06, 0.16), random.uniform(0.03, 0.08)};
  hull.rear = {0.50, random.uniform(0.05, 0.10), random.uniform(0.06, 0.14),
               random.uniform(0.03, 0.09), random.uniform(0.03, 0.08)};
  for (const Stretch& pane : car.panes) {
    hull.cuts.push_back(pane.rear);
    hull.cuts.push_back(pane.front);
  }
}

HullMaterials draw_materials(const Car& car, Random& random) {
  const bool clad = random.chance(car.kind == BodyKind::kSuv ? 0.6 : 0.1);
  const bool dark_frame = random.chance(0.4);
  const bool dark_bumper = random.chance(0.2);
  const bool high_lamps = random.chance(0.5);
  HullMaterials materials;
  materials.side = [car, clad, dark_frame](double x, int strip, double /*side*/) {
    if (strip <= kWellRoof || (clad && strip == kLowerSide)) return Surface::kTrim;
    const bool pane = strip == kLowerPane || strip == kUpperPane;
    if (pane && any_holds(car.panes, x)) return Surface::kCarGlass;
    const Stretch cabin{car.rear_header_x, car.cowl_x - 0.12};
    if ((pane || strip == kPaneFrame) && dark_frame && cabin.holds(x)) return Surface::kTrim;
    const bool screen = Stretch{car.header_x, car.cowl_x}.holds(x) ||
                        Stretch{car.deck_x, car.rear_header_x}.holds(x);
    return strip >= kOuterRoof && screen ? Surface::kCarGlass : Surface::kPaint;
  };
  materials.front = [dark_bumper](double share, int strip) {
    if (strip == kShoulder && share > 0.7) return Surface::kReflector;
    if (strip == kShoulder || (strip == kLowerSide && share < 0.7)) return Surface::kTrim;
    if (strip == kMiddleSide && share < 0.3) return Surface::kTrim;
    return strip <= kMiddleSide && dark_bumper ? Surface::kTrim : Surface::kPaint;
  };
  materials.rear = [dark_bumper, high_lamps](double share, int strip) {
    const bool lamp = strip == kShoulder || (!high_lamps && strip == kMiddleSide);
    if (lamp && share > 0.7) return Surface::kReflector;
    return strip == kLowerSide && dark_bumper ? Surface::kTrim : Surface::kPaint;
  };
  return materials;
}

void add_cabin(Mesh& mesh, const Car& car, Random& random) {
  const double belt = car.hull.belt_at(car.cowl_x);
  const double half = car.half_width - 0.16;
  // The hip of a driver is some 45 cm below the cowl's height and 1.25 m behind its foot.
  const double hip_z = belt - random.uniform(0.36, 0.42);
  const double front_x = std::max(car.cowl_x - random.uniform(1.20, 1.35), car.rear_axle + 0.55);
  const double rear_x = std::max(car.rear_axle + 0.02, car.rear_header_x + 0.1);
  for (const double side : {1.0, -1.0})
    add_seat(mesh, {{front_x, 0.5 * half * side, hip_z}, 0.92 * half});
  if (front_x - rear_x > 0.5)
    add_seat(mesh, {{rear_x, 0.0, hip_z + 0.03}, 1.9 * half, 0.46, 0.52, 2});
  add_block(mesh, {car.cowl_x - 0.50, -half, belt - 0.35}, {car.cowl_x - 0.10, half, belt - 0.03},
            Surface::kInterior);
  // Parcel shelf, or the cover of the boot.
  const double shelf_rear = std::max(car.deck_x + 0.06, -0.5 * car.length + 0.12);
  if (rear_x - 0.2 > shelf_rear)
    add_block(mesh, {shelf_rear, -half, belt - 0.08}, {rear_x - 0.2, half, belt - 0.05},
              Surface::kInterior);
  if (random.chance(0.35)) add_driver(mesh, {front_x, 0.5 * half, hip_z}, random);
}

void add_roof_rails(Mesh& mesh, const Car& car) {
  const Stretch roof{car.rear_header_x + 0.05, car.header_x - 0.05};
  const double y = car.half_width - 0.03 - car.hull.tumblehome * (0.33 * car.height);
  const double z = car.height - 0.03;
  for (const double side : {y, -y}) {
    add_limb(mesh,
             {{{roof.rear, side, z - 0.05}, 0.015},
              {{roof.rear + 0.12, side, z + 0.02}, 0.015},
              {{roof.front - 0.12, side, z + 0.02}, 0.015},
              {{roof.front, side, z - 0.05}, 0.015}},
             Surface::kChrome, 5);
  }
}

void add_outside(Mesh& mesh, const Car& car, Random& random) {
  const double front = 0.5 * car.length;
  add_plate(mesh, {front, 0.0, random.uniform(0.40, 0.50)});
  const bool in_bumper = random.chance(0.35);
  const double lean = car.hull.rear.lean_m;
  const double z = in_bumper ? 0.48 : car.hull.belt_at(-front) - random.uniform(0.18, 0.26);
  add_plate(mesh, {-front + (in_bumper ? 0.0 : 0.3 * lean), 0.0, z});
  const double mirror_x = car.cowl_x - random.uniform(0.30, 0.42);
  add_mirrors(mesh, {mirror_x, car.half_width - 0.03, car.hull.belt_at(mirror_x) + 0.03},
              random.uniform(0.05, 0.085), {0.11, 0.13});
  const bool rails = car.kind == BodyKind::kEstate || car.kind == BodyKind::kSuv;
  if (rails && random.chance(0.5)) add_roof_rails(mesh, car);
  if (rails && random.chance(0.04)) {
    const double x = 0.5 * (car.rear_header_x + car.header_x);
    add_ball(mesh, {x, 0.0, car.height + 0.18}, {0.95, 0.40, 0.18}, Surface::kTrim, 10);
  }
}

}  // namespace

Mesh make_car(BodyKind kind, Random& random) {
  Car car = draw_car(kind, random);
  draw_top(car, random);
  draw_belt(car, random);
  draw_panes(car, random);
  shape_hull(car, random);
  Mesh mesh;
  add_hull(mesh, car.hull, draw_materials(car, random));
  for (const double x : {car.front_axle, car.rear_axle})
    add_axle(mesh, x, car.half_width - 0.025, car.wheel);
  add_outside(mesh, car, random);
  add_cabin(mesh, car, random);
  settle(mesh);
  return mesh;
}

}  // namespace stillmap::simulation
