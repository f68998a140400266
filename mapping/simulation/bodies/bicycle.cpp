#include "bodies/bicycle.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

#include "bodies/body_shapes.hpp"
#include "bodies/open_wheel.hpp"

namespace stillmap::simulation {
namespace {

using Eigen::Vector3d;

constexpr double kTube = 0.016;
constexpr double kThinTube = 0.008;
constexpr double kCrank = 0.17;
/// Height of the bottom bracket and its distance from the rear axle: 0.28 and 0.44 on most.
constexpr double kBracketHeight = 0.28;
constexpr double kChainStay = 0.44;

/// Seat and head tubes of usual frames stand at some 72 and 70 degrees.
Vector3d seat_axis() { return {-0.309, 0.0, 0.951}; }
Vector3d head_axis() { return {-0.342, 0.0, 0.940}; }

/// Where the tubes meet.
struct Nodes {
  Vector3d rear, front, bracket, seat, head_low, head_high, bar;
};

Nodes nodes_of(const Bicycle& b) {
  Nodes n;
  const double r = b.wheel_radius_m;
  n.rear = {-0.5 * b.wheelbase_m, 0.0, r};
  n.front = {0.5 * b.wheelbase_m, 0.0, r};
  const double rise = r - kBracketHeight;
  n.bracket = n.rear + Vector3d(std::sqrt(kChainStay * kChainStay - rise * rise), 0.0, -rise);
  n.seat = n.bracket + (b.saddle_m - 0.16) * seat_axis();
  // The fork bends 45 mm forward to the axle.
  n.head_low = n.front + (r + 0.065) * head_axis() - Vector3d(0.045, 0.0, 0.0);
  n.head_high = n.head_low + b.head_tube_m * head_axis();
  n.bar = n.head_high +
          (b.sporty ? Vector3d(0.06, 0.0, 0.06) : Vector3d(0.0, 0.0, 0.02) + 0.12 * head_axis());
  return n;
}

void add_pipe(Mesh& mesh, const Vector3d& from, const Vector3d& to, double radius_m,
              Material material, int sides = 6) {
  add_limb(mesh, {{from, radius_m}, {to, radius_m}}, material, sides);
}

void add_frame(Mesh& mesh, const Bicycle& b, const Nodes& n) {
  const Vector3d seat_cluster = n.bracket + std::min(b.saddle_m - 0.18, 0.56) * seat_axis();
  add_pipe(mesh, n.bracket, seat_cluster, kTube, Surface::kPaint);
  add_pipe(mesh, seat_cluster, n.bracket + (b.saddle_m - 0.03) * seat_axis(), 0.013,
           Surface::kChrome);
  add_pipe(mesh, n.bracket, n.head_low + 0.03 * head_axis(), 0.019, Surface::kPaint);
  const Vector3d top_end =
      b.low_step ? Vector3d(n.bracket + 0.22 * seat_axis()) : seat_cluster - 0.03 * seat_axis();
  add_pipe(mesh, top_end, n.head_high - 0.03 * head_axis(), kTube, Surface::kPaint);
  add_pipe(mesh, n.head_low, n.head_high, 0.020, Surface::kPaint);
  for (const double y : {0.055, -0.055}) {
    const Vector3d out(0.0, y, 0.0);
    add_pipe(mesh, n.bracket + 0.5 * out, n.rear + out, 0.010, Surface::kPaint, 5);
    add_pipe(mesh, seat_cluster + 0.3 * out, n.rear + out, kThinTube, Surface::kPaint, 5);
  }
}

void add_saddle(Mesh& mesh, const Bicycle& b) {
  const Vector3d top = saddle_of(b);
  const double wide = b.sporty ? 0.07 : 0.10;
  const auto ring = [&](double x, double half_width, double half_height) {
    return Ring{top + Vector3d(x, 0.0, -half_height), Vector3d(0.0, 0.0, half_height),
                Vector3d(0.0, half_width, 0.0)};
  };
  add_tube(mesh,
           {ring(-0.12, 0.7 * wide, 0.025), ring(-0.06, wide, 0.035), ring(0.04, 0.4 * wide, 0.030),
            ring(0.14, 0.02, 0.018)},
           Surface::kTrim, 6);
}

void add_drive(Mesh& mesh, const Bicycle& b, const Nodes& n) {
  add_pipe(mesh, n.bracket - Vector3d(0.0, 0.055, 0.0), n.bracket - Vector3d(0.0, 0.045, 0.0), 0.09,
           Surface::kTrim, 12);
  const auto pedals = pedals_of(b);
  for (const std::size_t which : {0U, 1U}) {
    const Vector3d pedal = pedals.at(which) - Vector3d(0.0, 0.0, 0.012);
    const double y = which == 0 ? 0.075 : -0.075;
    add_pipe(mesh, n.bracket + Vector3d(0.0, y, 0.0), {pedal.x(), y, pedal.z()}, 0.011,
             Surface::kChrome, 4);
    add_block(mesh, pedal - Vector3d(0.045, 0.045, 0.012), pedal + Vector3d(0.045, 0.045, 0.012),
              Surface::kTrim);
  }
  // Guard over both runs of the chain, or the chain.
  const double half = b.mudguards ? 0.035 : 0.006;
  for (const double up : b.mudguards ? std::vector<double>{0.05} : std::vector<double>{0.07, -0.05})
    mesh.add_quad(n.bracket + Vector3d(0.08, -0.06, up + half),
                  n.bracket + Vector3d(0.08, -0.06, up - half),
                  n.rear + Vector3d(-0.03, -0.06, 0.5 * up - half),
                  n.rear + Vector3d(-0.03, -0.06, 0.5 * up + half), Surface::kTrim);
}

void add_rear_fittings(Mesh& mesh, const Bicycle& b, const Nodes& n) {
  const double top = 2.0 * b.wheel_radius_m + 0.06;
  if (b.mudguards)
    add_mudguard(mesh, n.rear, {b.wheel_radius_m + 0.02, 0.027, 0.15, 3.3}, Surface::kTrim);
  const Vector3d lamp(n.rear.x() - (b.rack ? 0.22 : 0.10), 0.0, b.rack ? top - 0.03 : top + 0.05);
  add_block(mesh, lamp - Vector3d(0.01, 0.04, 0.025), lamp + Vector3d(0.01, 0.04, 0.025),
            Surface::kReflector);
  if (!b.rack) return;
  for (const double y : {0.06, -0.06}) {
    const Vector3d end(n.rear.x() - 0.20, y, top);
    add_pipe(mesh, {n.seat.x() + 0.02, 0.4 * y, top}, end, 0.006, Surface::kTrim, 4);
    for (const double x : {-0.10, 0.10})
      add_pipe(mesh, n.rear + Vector3d(0.0, y, 0.0), {n.rear.x() + x, y, top}, 0.005,
               Surface::kTrim, 4);
    if (b.panniers)
      add_block(mesh, {n.rear.x() - 0.20, y > 0.0 ? y : y - 0.14, top - 0.38},
                {n.rear.x() + 0.14, y > 0.0 ? y + 0.14 : y, top}, Material(Surface::kCloth, 0.7));
  }
  add_block(mesh, {n.rear.x() - 0.19, -0.04, top - 0.004}, {n.rear.x() + 0.16, 0.04, top + 0.004},
            Surface::kTrim);
}

void add_bar(Mesh& mesh, const Bicycle& b, const Nodes& n) {
  add_pipe(mesh, n.head_high, n.bar, 0.013, Surface::kChrome);
  const auto grips = grips_of(b);
  for (const Vector3d& grip : grips) {
    const Vector3d inner(n.bar.x() + (b.sporty ? 0.0 : 0.03), 0.55 * grip.y(),
                         n.bar.z() + (b.sporty ? 0.0 : 0.03));
    const Vector3d tip = grip + 0.06 * (grip - inner).normalized();
    add_limb(mesh, {{n.bar, 0.012}, {inner, 0.012}, {grip, 0.015}, {tip, 0.016}}, Surface::kTrim,
             6);
  }
  add_ball(mesh, n.head_low + Vector3d(0.07, 0.0, 0.10), {0.045, 0.035, 0.035}, Surface::kReflector,
           6);
}

/// What turns with the fork.
Mesh front_of(const Bicycle& b, const Nodes& n, const OpenWheel& wheel) {
  Mesh mesh;
  add_open_wheel(mesh, n.front, wheel);
  for (const double y : {0.05, -0.05})
    add_limb(mesh,
             {{n.front + Vector3d(0.0, y, 0.0), 0.008},
              {n.front + 0.18 * head_axis() + Vector3d(-0.035, y, 0.0), 0.011},
              {n.head_low + Vector3d(0.0, 0.6 * y, 0.0), 0.014}},
             Surface::kPaint, 5);
  if (b.mudguards)
    add_mudguard(mesh, n.front, {b.wheel_radius_m + 0.02, 0.025, 0.9, 3.4}, Surface::kTrim);
  add_bar(mesh, b, n);
  if (b.basket) {
    const Vector3d low(n.bar.x() + 0.06, -0.18, n.bar.z() - 0.28);
    const Material wicker(Surface::kTrim, 1.8);
    // Open on top.
    for (const double y : {-0.18, 0.18})
      mesh.add_quad({low.x(), y, low.z()}, {low.x() + 0.24, y, low.z()},
                    {low.x() + 0.26, y, low.z() + 0.24}, {low.x(), y, low.z() + 0.24}, wicker);
    mesh.add_quad(low, low + Vector3d(0.24, 0.0, 0.0), low + Vector3d(0.24, 0.36, 0.0),
                  low + Vector3d(0.0, 0.36, 0.0), wicker);
    for (const double x : {0.0, 0.24})
      mesh.add_quad(low + Vector3d(x, 0.0, 0.0), low + Vector3d(x, 0.36, 0.0),
                    low + Vector3d(1.08 * x, 0.36, 0.24), low + Vector3d(1.08 * x, 0.0, 0.24),
                    wicker);
  }
  return mesh;
}

}  // namespace

Bicycle draw_bicycle(Random& random, double rider_height_m) {
  Bicycle b;
  b.wheel_radius_m = random.uniform(0.325, 0.350);
  b.sporty = random.chance(0.4);
  b.tyre_m = b.sporty ? random.uniform(0.013, 0.025) : random.uniform(0.019, 0.024);
  // So high that the leg is almost straight when the pedal is lowest.
  b.saddle_m = 0.46 * rider_height_m - 0.15;
  b.wheelbase_m = (b.sporty ? 1.02 : 1.07) + random.uniform(-0.02, 0.03);
  b.head_tube_m = std::clamp(0.14 + 0.5 * (rider_height_m - 1.72), 0.10, 0.24);
  b.low_step = !b.sporty && random.chance(0.5);
  b.mudguards = !b.sporty || random.chance(0.3);
  b.rack = b.mudguards && random.chance(0.8);
  b.basket = !b.sporty && random.chance(0.3);
  b.panniers = b.rack && random.chance(0.25);
  b.wheel_turn_rad = random.uniform(0.0, 2.0 * std::numbers::pi);
  return b;
}

Vector3d saddle_of(const Bicycle& b) { return nodes_of(b).bracket + b.saddle_m * seat_axis(); }

std::array<Vector3d, 2> grips_of(const Bicycle& b) {
  const Vector3d bar = nodes_of(b).bar;
  const Vector3d back = b.sporty ? Vector3d(-0.02, 0.0, 0.01) : Vector3d(-0.14, 0.0, 0.04);
  const Vector3d out(0.0, b.sporty ? 0.25 : 0.26, 0.0);
  return {bar + back + out, bar + back - out};
}

std::array<Vector3d, 2> pedals_of(const Bicycle& b) {
  const Vector3d bracket = nodes_of(b).bracket + Vector3d(0.0, 0.0, 0.012);
  const Vector3d crank(kCrank * std::sin(b.crank_rad), 0.0, kCrank * std::cos(b.crank_rad));
  const Vector3d out(0.0, 0.14, 0.0);
  return {bracket + crank + out, bracket - crank - out};
}

void add_bicycle(Mesh& mesh, const Bicycle& b) {
  const Nodes n = nodes_of(b);
  OpenWheel wheel{.radius_m = b.wheel_radius_m, .tyre_m = b.tyre_m};
  wheel.turn_rad = b.wheel_turn_rad;
  add_open_wheel(mesh, n.rear, wheel);
  add_frame(mesh, b, n);
  add_saddle(mesh, b);
  add_drive(mesh, b, n);
  add_rear_fittings(mesh, b, n);
  if (b.kickstand)
    add_pipe(mesh, n.rear + Vector3d(0.12, 0.05, -0.05), {n.rear.x() + 0.08, 0.20, 0.025}, 0.008,
             Surface::kTrim, 4);
  mesh.add(front_of(b, n, wheel), steered(n.head_low, head_axis(), b.steering_rad));
}

}  // namespace stillmap::simulation
