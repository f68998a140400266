#include "bodies/motorcycle.hpp"

#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

#include "bodies/body_shapes.hpp"
#include "bodies/open_wheel.hpp"

namespace stillmap::simulation {
namespace {

using Eigen::Vector3d;
using Style = Motorcycle::Style;

/// Across a hull that runs along x [m].
struct HullSection {
  double x, z, half_width, half_height;
};

void add_hull(Mesh& mesh, const std::vector<HullSection>& sections, Material material,
              int sides = 10) {
  std::vector<Ring> rings;
  for (const HullSection& s : sections)
    rings.push_back(
        {{s.x, 0.0, s.z}, Vector3d(0.0, 0.0, s.half_height), Vector3d(0.0, s.half_width, 0.0)});
  add_tube(mesh, rings, material, sides);
}

Vector3d front_axle(const Motorcycle& m) { return {0.5 * m.wheelbase_m, 0.0, m.wheel_radius_m}; }
Vector3d rear_axle(const Motorcycle& m) { return {-0.5 * m.wheelbase_m, 0.0, m.wheel_radius_m}; }

/// Forks stand at some 65 degrees.
Vector3d fork_axis() { return {-0.423, 0.0, 0.906}; }

/// Where the steering's axis meets the handlebar.
Vector3d fork_top(const Motorcycle& m) {
  const Vector3d axle = front_axle(m);
  return axle + (m.grip_height_m - 0.05 - axle.z()) / fork_axis().z() * fork_axis();
}

OpenWheel wheel_of(const Motorcycle& m, bool front) {
  const bool scooter = m.style == Style::kScooter;
  return {.radius_m = m.wheel_radius_m,
          .tyre_m = scooter ? 0.050 : (front ? 0.055 : 0.075),
          .rim_depth_m = 0.03,
          .hub_radius_m = scooter ? 0.07 : 0.05,
          .hub_width_m = 0.12,
          .spokes = 5,
          .spoke_radius_m = 0.018};
}

void add_mirrors(Mesh& mesh, const Motorcycle& m) {
  for (const Vector3d& grip : grips_of(m)) {
    const Vector3d stem(grip.x() + 0.08, 0.75 * grip.y(), grip.z());
    const Vector3d glass = stem + Vector3d(0.02, 0.25 * grip.y(), 0.14);
    add_limb(mesh, {{stem, 0.007}, {glass, 0.007}}, Surface::kTrim, 4);
    add_block(mesh, glass - Vector3d(0.015, 0.06, 0.035), glass + Vector3d(0.015, 0.06, 0.035),
              Surface::kTrim);
  }
}

void add_bar(Mesh& mesh, const Motorcycle& m) {
  const Vector3d top = fork_top(m);
  for (const Vector3d& grip : grips_of(m)) {
    const Vector3d bend(top.x(), 0.45 * grip.y(), grip.z());
    add_limb(mesh,
             {{top, 0.015},
              {bend, 0.013},
              {grip, 0.017},
              {grip + Vector3d(-0.02, grip.y() > 0.0 ? 0.05 : -0.05, 0.0), 0.018}},
             Surface::kTrim, 6);
  }
}

/// What turns with the fork.
Mesh front_of(const Motorcycle& m) {
  Mesh mesh;
  const OpenWheel wheel = wheel_of(m, true);
  const Vector3d axle = front_axle(m);
  add_open_wheel(mesh, axle, wheel);
  const Vector3d top = fork_top(m);
  const Vector3d fork_end = m.style == Style::kScooter ? Vector3d(axle + 0.5 * (top - axle)) : top;
  for (const double y : {0.10, -0.10}) {
    const Vector3d out(0.0, y, 0.0);
    const Vector3d middle = axle + 0.5 * (fork_end - axle) + out;
    add_limb(mesh, {{axle + out, 0.030}, {middle, 0.028}, {fork_end + out, 0.022}},
             Material(Surface::kTrim, 2.0), 6);
    if (m.style != Style::kScooter)
      add_limb(mesh, {{axle + 0.65 * out, 0.14}, {axle + 0.70 * out, 0.14}}, Surface::kChrome, 12);
  }
  add_mudguard(mesh, axle, {wheel.radius_m + 0.03, wheel.tyre_m + 0.02, 0.5, 2.8}, Surface::kPaint);
  add_bar(mesh, m);
  add_mirrors(mesh, m);
  const Vector3d lamp =
      top + (m.style == Style::kScooter ? Vector3d(0.10, 0.0, -0.02) : Vector3d(0.17, 0.0, -0.14));
  add_ball(mesh, lamp - Vector3d(0.03, 0.0, 0.0), {0.09, 0.095, 0.095}, Surface::kTrim);
  add_hull(mesh,
           {{lamp.x() + 0.050, lamp.z(), 0.08, 0.08}, {lamp.x() + 0.065, lamp.z(), 0.06, 0.06}},
           Surface::kReflector, 8);
  return mesh;
}

void add_plate(Mesh& mesh, double x, double z) {
  mesh.add_quad({x, 0.09, z}, {x, -0.09, z}, {x + 0.04, -0.09, z + 0.20},
                {x + 0.04, 0.09, z + 0.20}, Surface::kPlate);
  add_block(mesh, {x + 0.03, -0.06, z + 0.22}, {x + 0.08, 0.06, z + 0.27}, Surface::kReflector);
  for (const double y : {0.17, -0.17})
    add_ball(mesh, {x + 0.10, y, z + 0.22}, {0.03, 0.03, 0.02}, Surface::kReflector, 5);
}

void add_engine(Mesh& mesh, const Motorcycle& m) {
  const Material metal(Surface::kTrim, 1.9);
  add_hull(mesh,
           {{0.28, 0.46, 0.12, 0.13},
            {0.18, 0.42, 0.20, 0.19},
            {-0.12, 0.40, 0.21, 0.18},
            {-0.26, 0.42, 0.12, 0.14}},
           metal, 8);
  add_hull(mesh, {{0.30, 0.66, 0.14, 0.10}, {0.0, 0.62, 0.15, 0.12}}, metal, 4);
  const Vector3d top = fork_top(m);
  for (const double y : {0.09, -0.09}) {
    add_limb(mesh,
             {{{top.x() - 0.02, 0.5 * y, top.z() - 0.16}, 0.025}, {{0.22, 1.5 * y, 0.40}, 0.020}},
             Surface::kTrim, 6);
    add_limb(mesh, {{{-0.22, y, 0.40}, 0.035}, {rear_axle(m) + Vector3d(0.0, 1.3 * y, 0.0), 0.028}},
             Surface::kTrim, 6);
    add_limb(mesh, {{{-0.30, y, 0.48}, 0.022}, {{-0.62, y, 0.74}, 0.022}}, Surface::kTrim, 5);
  }
  // Exhaust on the right.
  add_limb(mesh,
           {{{0.27, -0.06, 0.52}, 0.025},
            {{0.36, -0.08, 0.32}, 0.025},
            {{0.20, -0.13, 0.18}, 0.028},
            {{-0.28, -0.19, 0.24}, 0.040},
            {{-0.40, -0.20, 0.28}, 0.058},
            {{-0.84, -0.22, 0.42}, 0.058}},
           Surface::kChrome, 7);
  for (const Vector3d& peg : pegs_of(m))
    add_limb(mesh,
             {{{peg.x(), 0.4 * peg.y(), peg.z() - 0.02}, 0.014},
              {peg - Vector3d(0.0, 0.0, 0.02), 0.014}},
             Surface::kTrim, 4);
}

void add_tank_and_seat(Mesh& mesh, const Motorcycle& m) {
  const double s = m.seat_height_m;
  add_hull(mesh,
           {{0.36, s + 0.04, 0.07, 0.07},
            {0.30, s + 0.06, 0.14, 0.12},
            {0.10, s + 0.06, 0.16, 0.13},
            {-0.12, s - 0.01, 0.10, 0.08},
            {-0.18, s - 0.04, 0.08, 0.04}},
           Surface::kPaint);
  add_hull(mesh,
           {{-0.10, s - 0.04, 0.09, 0.03},
            {-0.30, s - 0.04, 0.14, 0.04},
            {-0.50, s - 0.02, 0.14, 0.05},
            {-0.56, s + 0.02, 0.12, 0.06},
            {-0.80, s + 0.05, 0.10, 0.05}},
           Surface::kTrim, 8);
  add_hull(
      mesh,
      {{-0.25, s - 0.12, 0.12, 0.08}, {-0.60, s - 0.05, 0.11, 0.07}, {-0.90, s + 0.02, 0.06, 0.04}},
      Surface::kPaint, 8);
  add_mudguard(mesh, rear_axle(m), {m.wheel_radius_m + 0.05, 0.09, 1.2, 2.7}, Surface::kTrim);
  add_limb(mesh, {{{-0.86, 0.0, s - 0.02}, 0.02}, {{-1.00, 0.0, s - 0.18}, 0.02}}, Surface::kTrim,
           4);
  add_plate(mesh, -1.05, s - 0.32);
}

void add_fairing(Mesh& mesh, const Motorcycle& m) {
  const double s = m.seat_height_m;
  add_hull(mesh,
           {{0.82, s + 0.06, 0.09, 0.07},
            {0.72, s + 0.08, 0.18, 0.15},
            {0.52, s + 0.06, 0.27, 0.22},
            {0.34, s - 0.02, 0.27, 0.22}},
           Surface::kPaint);
  for (const double y : {1.0, -1.0}) {
    mesh.add_quad({0.58, 0.26 * y, s}, {0.30, 0.28 * y, s}, {0.12, 0.25 * y, 0.36},
                  {0.36, 0.22 * y, 0.32}, Surface::kPaint);
    // Cases beside the rear wheel.
    add_block(mesh, {-0.95, y > 0.0 ? 0.22 : -0.44, 0.46}, {-0.48, y > 0.0 ? 0.44 : -0.22, 0.80},
              Material(Surface::kTrim, 1.5));
  }
  mesh.add_quad({0.70, 0.16, s + 0.20}, {0.70, -0.16, s + 0.20}, {0.44, -0.20, s + 0.50},
                {0.44, 0.20, s + 0.50}, Surface::kCarGlass);
}

void add_scooter_body(Mesh& mesh, const Motorcycle& m) {
  const double s = m.seat_height_m;
  const Vector3d top = fork_top(m);
  // Leg shield, bent around the fork.
  for (const double y : {1.0, -1.0}) {
    mesh.add_quad({top.x() + 0.12, 0.0, top.z() - 0.06}, {top.x() - 0.01, 0.20 * y, top.z() - 0.12},
                  {0.30, 0.24 * y, 0.34}, {0.46, 0.0, 0.36}, Surface::kPaint);
    mesh.add_quad({top.x() - 0.03, 0.0, top.z() - 0.08}, {top.x() - 0.02, 0.20 * y, top.z() - 0.12},
                  {0.28, 0.24 * y, 0.34}, {0.28, 0.0, 0.34}, Surface::kTrim);
  }
  add_block(mesh, {-0.12, -0.20, 0.22}, {0.32, 0.20, 0.30}, Surface::kTrim);
  add_hull(mesh,
           {{-0.02, 0.48, 0.13, 0.20},
            {-0.20, 0.54, 0.19, 0.22},
            {-0.55, 0.58, 0.19, 0.18},
            {-0.88, 0.66, 0.08, 0.08}},
           Surface::kPaint);
  add_hull(mesh,
           {{0.02, s - 0.05, 0.08, 0.04},
            {-0.15, s - 0.05, 0.15, 0.05},
            {-0.55, s - 0.02, 0.15, 0.06},
            {-0.80, s, 0.10, 0.05}},
           Surface::kTrim, 8);
  add_hull(mesh, {{-0.10, 0.30, 0.10, 0.10}, {-0.70, 0.28, 0.09, 0.09}}, Surface::kTrim, 8);
  add_limb(mesh, {{{-0.30, -0.19, 0.30}, 0.06}, {{-0.80, -0.19, 0.36}, 0.06}}, Surface::kChrome, 7);
  add_plate(mesh, -0.96, 0.42);
}

}  // namespace

Motorcycle draw_motorcycle(Random& random) {
  Motorcycle m;
  const double kind = random.uniform();
  m.style = kind < 0.40 ? Style::kScooter : (kind < 0.75 ? Style::kNaked : Style::kTourer);
  const bool scooter = m.style == Style::kScooter;
  m.wheel_radius_m = scooter ? random.uniform(0.22, 0.27) : random.uniform(0.295, 0.32);
  m.wheelbase_m = scooter ? random.uniform(1.28, 1.38) : random.uniform(1.39, 1.50);
  m.seat_height_m = scooter ? random.uniform(0.76, 0.80) : random.uniform(0.77, 0.84);
  m.grip_height_m = scooter ? random.uniform(0.98, 1.04) : random.uniform(1.02, 1.12);
  m.top_box = random.chance(0.3);
  return m;
}

Vector3d seat_of(const Motorcycle& m) {
  return {m.style == Style::kScooter ? -0.28 : -0.32, 0.0, m.seat_height_m};
}

std::array<Vector3d, 2> grips_of(const Motorcycle& m) {
  const double x = fork_top(m).x() - (m.style == Style::kScooter ? 0.08 : 0.12);
  const double y = m.style == Style::kScooter ? 0.30 : 0.33;
  return {Vector3d(x, y, m.grip_height_m), Vector3d(x, -y, m.grip_height_m)};
}

std::array<Vector3d, 2> pegs_of(const Motorcycle& m) {
  if (m.style == Style::kScooter) return {Vector3d(0.18, 0.13, 0.30), Vector3d(0.18, -0.13, 0.30)};
  return {Vector3d(-0.16, 0.27, 0.34), Vector3d(-0.16, -0.27, 0.34)};
}

void add_motorcycle(Mesh& mesh, const Motorcycle& m) {
  add_open_wheel(mesh, rear_axle(m), wheel_of(m, false));
  if (m.style == Style::kScooter) {
    add_scooter_body(mesh, m);
  } else {
    add_engine(mesh, m);
    add_tank_and_seat(mesh, m);
  }
  if (m.style == Style::kTourer) add_fairing(mesh, m);
  if (m.top_box) {
    const double s = m.seat_height_m;
    add_block(mesh, {-1.02, -0.20, s + 0.06}, {-0.66, 0.20, s + 0.36},
              Material(Surface::kTrim, 1.2));
  }
  mesh.add(front_of(m), steered(fork_top(m), fork_axis(), m.steering_rad));
}

}  // namespace stillmap::simulation
