#include "bodies/vehicle_parts.hpp"

#include <algorithm>
#include <cmath>

namespace stillmap::simulation {

using Eigen::Vector3d;

double draw(const Spread& spread, Random& random) {
  return std::clamp(spread.mean + spread.deviation * random.normal(), spread.least, spread.most);
}

bool any_holds(const std::vector<Stretch>& stretches, double x) {
  return std::any_of(stretches.begin(), stretches.end(),
                     [&](const Stretch& stretch) { return stretch.holds(x); });
}

void add_axle(Mesh& mesh, double x, double half_track_m, const Wheel& wheel) {
  for (const double side : {1.0, -1.0})
    add_wheel(mesh, {x, side * half_track_m, wheel.radius_m}, side, wheel);
}

void add_plate(Mesh& mesh, const Vector3d& centre) {
  // 520 mm x 110 mm, as in most of Europe.
  const Vector3d half(0.012, 0.26, 0.055);
  add_block(mesh, centre - half, centre + half, Surface::kPlate);
}

void add_mirrors(Mesh& mesh, const Vector3d& left, double out_m, const Eigen::Vector2d& size_m) {
  for (const double side : {1.0, -1.0}) {
    const double inner = side * (left.y() - 0.06);
    const double outer = side * (left.y() + out_m);
    add_block(mesh, {left.x() - 0.5 * size_m.x(), std::min(inner, outer), left.z()},
              {left.x() + 0.5 * size_m.x(), std::max(inner, outer), left.z() + size_m.y()},
              Surface::kPaint);
  }
}

void add_seat(Mesh& mesh, const Seat& seat) {
  const double half = 0.5 * seat.width_m;
  add_block(mesh, seat.hip + Vector3d(0.0, -half, -0.18),
            seat.hip + Vector3d(seat.cushion_m, half, 0.0), Surface::kInterior);
  constexpr double kLean = 0.35;  // [rad], 20 degrees
  const Eigen::Isometry3d T_hull_back =
      Eigen::Translation3d(seat.hip) * Eigen::AngleAxisd(-kLean, Vector3d::UnitY());
  mesh.add_box(T_hull_back, {-0.14, -half, -0.12}, {0.0, half, seat.back_m}, Surface::kInterior);
  for (int i = 0; i < seat.head_rests; ++i) {
    const double y = seat.width_m * ((i + 0.5) / seat.head_rests - 0.5);
    mesh.add_box(T_hull_back, {-0.11, y - 0.13, seat.back_m + 0.02},
                 {-0.02, y + 0.13, seat.back_m + 0.19}, Surface::kInterior);
  }
}

void add_driver(Mesh& mesh, const Vector3d& hip, Random& random) {
  // Who is tall sits lower and further back, so all heads end up within a few centimetres.
  const double back = random.uniform(0.46, 0.52);
  const double girth = random.uniform(0.9, 1.15);
  const Material top(Surface::kCloth, random.uniform(0.3, 1.8));
  const Vector3d shoulder = hip + Vector3d(-0.02, 0.0, back);
  add_limb(mesh,
           {{hip + Vector3d(0.10, 0.0, 0.06), 0.15 * girth},
            {hip + Vector3d(0.05, 0.0, 0.30), 0.16 * girth},
            {shoulder, 0.13 * girth}},
           top);
  for (const double side : {1.0, -1.0}) {
    const Vector3d wrist = hip + Vector3d(0.42, 0.15 * side, 0.34);
    add_limb(mesh,
             {{shoulder + Vector3d(0.0, 0.18 * side, -0.03), 0.055 * girth},
              {hip + Vector3d(0.20, 0.26 * side, 0.24), 0.045 * girth},
              {wrist, 0.03}},
             top, 5);
    add_ball(mesh, wrist + Vector3d(0.04, 0.0, 0.0), {0.05, 0.04, 0.04}, Surface::kSkin, 5);
  }
  add_ball(mesh, shoulder + Vector3d(0.03, 0.0, 0.25), {0.10, 0.08, 0.13}, Surface::kSkin);
}

}  // namespace stillmap::simulation
