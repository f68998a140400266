#include "bodies/person_bodies.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

#include "bodies/body_shapes.hpp"

namespace stillmap::simulation {
namespace {

using Eigen::Vector3d;

/// What somebody on foot wears and carries.
struct Outfit {
  Figure figure;
  /// Hem above the ground as share of the height; 0: neither skirt nor long coat.
  double hem = 0.0;
  /// 1: in the left hand, -1: in the right one, 0: none.
  double bag_side = 0.0;
  /// How far the hands hang from the hip joints to the side [m].
  double hands_out_m = 0.1;
};

Outfit draw_outfit(Random& random) {
  Outfit outfit;
  outfit.figure = draw_figure(random);
  const double child_height = random.uniform(1.12, 1.50);
  if (random.chance(0.12)) outfit.figure.height_m = child_height;
  if (random.chance(0.22)) outfit.hem = random.uniform(0.22, 0.36);
  outfit.figure.backpack = random.chance(0.2);
  if (random.chance(0.25)) outfit.bag_side = random.sign();
  outfit.hands_out_m = random.uniform(0.04, 0.11);
  return outfit;
}

/// Where an ankle is in its own part of the stride, seen from the hip [m].
struct Step {
  double ahead_m;
  double lift_m;
  double toes_down_rad;
};

/// Share of a stride that a foot is on the ground. Textbooks give 0.60 (Winter); part of that is
/// spent rolling over the toes, which moves the ankle on.
constexpr double kGroundShare = 0.55;

Step step_at(double phase, double stride_m, double height_m) {
  const double reach = 0.5 * kGroundShare * stride_m;
  if (phase < kGroundShare) {
    const double t = phase / kGroundShare;
    const double roll = std::clamp((t - 0.6) / 0.4, 0.0, 1.0);
    const double heel = std::clamp(1.0 - t / 0.15, 0.0, 1.0);
    return {reach * (1.0 - 2.0 * t), 0.055 * height_m * roll * roll, 0.7 * roll - 0.3 * heel};
  }
  const double t = (phase - kGroundShare) / (1.0 - kGroundShare);
  const double smooth = t * t * (3.0 - 2.0 * t);
  return {reach * (2.0 * smooth - 1.0),
          height_m * (0.055 * (1.0 - t) + 0.04 * std::sin(std::numbers::pi * t)), 0.7 - smooth};
}

Vector3d hanging_wrist(const Outfit& outfit, const Stance& stance, double side, double swing_rad) {
  const double h = outfit.figure.height_m;
  const double arm = 0.97 * (BodyShares::kUpperArm + BodyShares::kForearm) * h;
  const Vector3d shoulder = shoulders_of(outfit.figure, stance);
  const double y = side * (BodyShares::kShoulderHalfWidth * h + outfit.hands_out_m);
  return shoulder + Vector3d(arm * std::sin(swing_rad), y, -arm * std::cos(swing_rad) - 0.01 * h);
}

Stance standing(const Outfit& outfit) {
  const double h = outfit.figure.height_m;
  Stance stance;
  stance.hip = {0.0, 0.0, (BodyShares::kHip - 0.004) * h};
  for (const double side : {1.0, -1.0}) {
    const std::size_t which = side > 0.0 ? 0 : 1;
    stance.ankles.at(which) = {0.02 * side * h, 0.065 * side * h, BodyShares::kAnkle * h};
    stance.wrists.at(which) = hanging_wrist(outfit, stance, side, 0.08);
  }
  return stance;
}

/// @param phase  share of the stride since the left heel met the ground.
Stance walking(const Outfit& outfit, double phase, double stride_m) {
  const double h = outfit.figure.height_m;
  Stance stance;
  // Lowest with both feet on the ground, highest over the standing leg: some 4 cm apart (Winter).
  const double twice = std::cos(4.0 * std::numbers::pi * (phase - 0.02));
  stance.hip = {0.0, 0.0, (BodyShares::kHip - 0.027 - 0.012 * twice) * h};
  stance.lean_rad = 0.05;
  const double forth = std::cos(2.0 * std::numbers::pi * (phase - 0.02));
  stance.hip_turn_m = 0.035 * h * forth;
  for (const double side : {1.0, -1.0}) {
    const std::size_t which = side > 0.0 ? 0 : 1;
    const double own = side > 0.0 ? phase : std::fmod(phase + 0.5, 1.0);
    const Step step = step_at(own, stride_m, h);
    stance.ankles.at(which) = {step.ahead_m, 0.045 * side * h,
                               BodyShares::kAnkle * h + step.lift_m};
    stance.toes_down_rad.at(which) = step.toes_down_rad;
    // Arms swing against the legs.
    stance.wrists.at(which) = hanging_wrist(outfit, stance, side, 0.08 - 0.42 * side * forth);
  }
  return stance;
}

void add_skirt(Mesh& mesh, const Outfit& outfit, const Stance& stance) {
  const double h = outfit.figure.height_m;
  const double thick = outfit.figure.girth * h;
  const double stride = std::abs(stance.ankles[0].x() - stance.ankles[1].x());
  const double hem = outfit.hem * h;
  const double down = 1.0 - hem / stance.hip.z();
  add_tube(mesh,
           {{stance.hip + Vector3d(0.0, 0.0, 0.06 * h), Vector3d(0.068 * thick, 0.0, 0.0),
             Vector3d(0.0, 0.09 * thick, 0.0)},
            {stance.hip, Vector3d(0.078 * thick, 0.0, 0.0), Vector3d(0.0, 0.104 * thick, 0.0)},
            {Vector3d(0.0, 0.0, hem), Vector3d(0.085 * thick + 0.5 * down * stride, 0.0, 0.0),
             Vector3d(0.0, 0.12 * thick, 0.0)}},
           outfit.figure.top, 10);
}

void add_bag(Mesh& mesh, const Outfit& outfit, const Stance& stance) {
  const Vector3d hand = stance.wrists.at(outfit.bag_side > 0.0 ? 0 : 1) -
                        Vector3d(0.0, 0.0, 0.09 * outfit.figure.height_m);
  add_block(mesh, hand + Vector3d(-0.16, -0.06, -0.28), hand + Vector3d(0.16, 0.06, 0.0),
            Material(Surface::kCloth, 0.6));
}

Mesh posture_of(const Outfit& outfit, const Stance& stance) {
  Mesh mesh;
  add_person(mesh, outfit.figure, stance);
  if (outfit.hem > 0.0) add_skirt(mesh, outfit, stance);
  if (outfit.bag_side != 0.0) add_bag(mesh, outfit, stance);
  return mesh;
}

}  // namespace

Body make_pedestrian(Random& random) {
  constexpr int kPhases = 8;
  const Outfit outfit = draw_outfit(random);
  Body body;
  body.kind = BodyKind::kPedestrian;
  body.object_class = maps::ObjectClass::kPedestrian;
  // Two steps of 0.41 of the height each, as at an easy pace.
  body.stride_m = outfit.figure.height_m * random.uniform(0.76, 0.88);
  body.postures.push_back(posture_of(outfit, standing(outfit)));
  for (int i = 0; i < kPhases; ++i)
    body.postures.push_back(
        posture_of(outfit, walking(outfit, static_cast<double>(i) / kPhases, body.stride_m)));
  settle_together(body.postures);
  return body;
}

}  // namespace stillmap::simulation
