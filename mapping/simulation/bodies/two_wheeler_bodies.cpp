#include "bodies/two_wheeler_bodies.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

#include "bodies/bicycle.hpp"
#include "bodies/body_shapes.hpp"
#include "bodies/motorcycle.hpp"
#include "bodies/person_bodies.hpp"

namespace stillmap::simulation {
namespace {

using Eigen::Vector3d;

/// The hip joints are that share of the height above what one sits on.
constexpr double kSeatToHip = 0.055;

/// Hands on the grips, and the torso so far forward that the arms reach them.
void reach_for(const Figure& figure, const std::array<Vector3d, 2>& grips, double least_lean_rad,
               Stance& stance) {
  const double h = figure.height_m;
  for (const std::size_t which : {0U, 1U})
    stance.wrists.at(which) = grips.at(which) + Vector3d(-0.045 * h, 0.0, 0.02 * h);
  const double arm = 0.94 * (BodyShares::kUpperArm + BodyShares::kForearm) * h;
  const Vector3d out(0.0, BodyShares::kShoulderHalfWidth * h, -0.015 * h);
  stance.lean_rad = least_lean_rad;
  while (stance.lean_rad < 1.0 &&
         (shoulders_of(figure, stance) + out - stance.wrists[0]).norm() > arm)
    stance.lean_rad += 0.02;
}

/// Ankle of a foot whose ball rests on a pedal or a peg.
Vector3d ankle_over(const Figure& figure, const Vector3d& sole, double toes_down_rad) {
  const double back = 0.45 * BodyShares::kFoot * figure.height_m;
  const double up = BodyShares::kAnkle * figure.height_m;
  return sole + Vector3d(-back * std::cos(toes_down_rad) + up * std::sin(toes_down_rad), 0.0,
                         back * std::sin(toes_down_rad) + up * std::cos(toes_down_rad));
}

Stance riding(const Figure& figure, const Bicycle& bicycle) {
  Stance stance;
  stance.hip = saddle_of(bicycle) + Vector3d(0.0, 0.0, kSeatToHip * figure.height_m);
  reach_for(figure, grips_of(bicycle), 0.12, stance);
  const auto pedals = pedals_of(bicycle);
  for (const std::size_t which : {0U, 1U}) {
    // Toes point down most while the pedal rises at the back.
    const double crank = bicycle.crank_rad + (which == 0 ? 0.0 : std::numbers::pi);
    stance.toes_down_rad.at(which) = 0.2 - 0.2 * std::sin(crank);
    stance.ankles.at(which) = ankle_over(figure, pedals.at(which), stance.toes_down_rad.at(which));
  }
  return stance;
}

/// Astride in front of the saddle, the left foot on the ground, the right one on its pedal.
Stance stopped(const Figure& figure, const Bicycle& bicycle) {
  const double h = figure.height_m;
  Stance stance = riding(figure, bicycle);
  const Vector3d saddle = saddle_of(bicycle);
  stance.hip = {saddle.x() + 0.20, 0.02, (BodyShares::kHip - 0.02) * h};
  stance.lean_rad = 0.0;
  reach_for(figure, grips_of(bicycle), 0.05, stance);
  stance.ankles[0] = {stance.hip.x() + 0.02, 0.20, BodyShares::kAnkle * h};
  stance.toes_down_rad[0] = 0.0;
  return stance;
}

Mesh cyclist_posture(const Figure& figure, const Bicycle& bicycle, const Stance& stance) {
  Mesh mesh;
  add_bicycle(mesh, bicycle);
  add_person(mesh, figure, stance);
  return mesh;
}

/// On its side stand.
Mesh parked(const Mesh& upright, double lean_rad) {
  Mesh mesh;
  mesh.add(upright, Eigen::Isometry3d(Eigen::AngleAxisd(-lean_rad, Vector3d::UnitX())));
  settle(mesh);
  return mesh;
}

Figure draw_rider(Random& random, double helmet_share) {
  Figure figure = draw_figure(random);
  figure.helmet = random.chance(helmet_share);
  figure.backpack = random.chance(0.2);
  return figure;
}

}  // namespace

Body make_motorcycle(Random& random) {
  Motorcycle motorcycle = draw_motorcycle(random);
  motorcycle.steering_rad = random.uniform(0.0, 0.5);
  Mesh upright;
  add_motorcycle(upright, motorcycle);
  return {.kind = BodyKind::kMotorcycle,
          .object_class = maps::ObjectClass::kMotorcycle,
          .postures = {parked(upright, random.uniform(0.08, 0.16))},
          .stride_m = 0.0};
}

Body make_motorcyclist(Random& random) {
  const Motorcycle motorcycle = draw_motorcycle(random);
  Figure figure = draw_rider(random, 1.0);
  // Jackets are thick, and mostly dark.
  figure.girth = std::min(1.1 * figure.girth, 1.4);
  figure.top = Material(Surface::kCloth, random.uniform(0.2, 1.0));
  Stance stance;
  stance.hip = seat_of(motorcycle) + Vector3d(0.0, 0.0, kSeatToHip * figure.height_m);
  reach_for(figure, grips_of(motorcycle), 0.10, stance);
  const auto pegs = pegs_of(motorcycle);
  for (const std::size_t which : {0U, 1U})
    stance.ankles.at(which) = ankle_over(figure, pegs.at(which), 0.0);
  Mesh mesh;
  add_motorcycle(mesh, motorcycle);
  add_person(mesh, figure, stance);
  settle(mesh);
  return {.kind = BodyKind::kMotorcyclist,
          .object_class = maps::ObjectClass::kMotorcycle,
          .postures = {mesh},
          .stride_m = 0.0};
}

Body make_bicycle(Random& random) {
  const double rider_height = std::clamp(1.72 + 0.09 * random.normal(), 1.50, 1.95);
  Bicycle bicycle = draw_bicycle(random, rider_height);
  bicycle.kickstand = true;
  bicycle.crank_rad = random.uniform(0.0, 2.0 * std::numbers::pi);
  bicycle.steering_rad = random.uniform(-0.1, 0.5);
  Mesh upright;
  add_bicycle(upright, bicycle);
  return {.kind = BodyKind::kBicycle,
          .object_class = maps::ObjectClass::kCyclist,
          .postures = {parked(upright, random.uniform(0.06, 0.12))},
          .stride_m = 0.0};
}

Body make_cyclist(Random& random) {
  constexpr int kPhases = 6;
  const Figure figure = draw_rider(random, 0.4);
  Bicycle bicycle = draw_bicycle(random, figure.height_m);
  Body body;
  body.kind = BodyKind::kCyclist;
  body.object_class = maps::ObjectClass::kCyclist;
  // One turn of the cranks in a middle gear: 2.2 to 2.6 turns of a wheel of 2.1 m around.
  body.stride_m = random.uniform(4.6, 5.5);
  bicycle.crank_rad = 1.5 * std::numbers::pi;
  body.postures.push_back(cyclist_posture(figure, bicycle, stopped(figure, bicycle)));
  for (int i = 0; i < kPhases; ++i) {
    const double share = static_cast<double>(i) / kPhases;
    bicycle.crank_rad = 2.0 * std::numbers::pi * share;
    bicycle.wheel_turn_rad = share * body.stride_m / bicycle.wheel_radius_m;
    body.postures.push_back(cyclist_posture(figure, bicycle, riding(figure, bicycle)));
  }
  settle_together(body.postures);
  return body;
}

}  // namespace stillmap::simulation
