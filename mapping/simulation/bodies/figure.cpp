#include <algorithm>
#include <cmath>
#include <cstddef>

#include "bodies/body_shapes.hpp"
#include "bodies/person_bodies.hpp"

namespace stillmap::simulation {
namespace {

using Eigen::Vector3d;

/// Middle joint and end of a limb of two bones.
struct Bend {
  Vector3d middle;
  Vector3d end;
};

/// From `from` as far towards `to` as the bones reach; the middle joint points to `bulge`.
Bend bent(const Vector3d& from, const Vector3d& to, const std::array<double, 2>& bones_m,
          const Vector3d& bulge) {
  const auto [upper, lower] = bones_m;
  const double shortest = 0.3 * (upper + lower);
  const double way = std::clamp((to - from).norm(), shortest, 0.998 * (upper + lower));
  const Vector3d along = (to - from).normalized();
  const double share = (upper * upper - lower * lower + way * way) / (2.0 * way);
  const double out = std::sqrt(std::max(upper * upper - share * share, 0.0));
  const Vector3d across = (bulge - bulge.dot(along) * along).normalized();
  return {from + share * along + out * across, from + way * along};
}

Vector3d torso_axis(double lean_rad) { return {std::sin(lean_rad), 0.0, std::cos(lean_rad)}; }

void add_torso(Mesh& mesh, const Figure& figure, const Stance& stance) {
  // Height above the hip, half width and half depth as shares of the person's height.
  struct Slice {
    double up, half_width, half_depth;
  };
  constexpr std::array<Slice, 6> kSlices{{{-0.045, 0.080, 0.055},
                                          {0.000, 0.096, 0.068},
                                          {0.080, 0.084, 0.062},
                                          {0.200, 0.102, 0.070},
                                          {0.285, 0.108, 0.052},
                                          {0.330, 0.032, 0.032}}};
  const Vector3d up = torso_axis(stance.lean_rad);
  const Vector3d ahead(up.z(), 0.0, -up.x());
  std::vector<Ring> rings;
  for (const Slice& slice : kSlices)
    rings.push_back({stance.hip + figure.height_m * slice.up * up,
                     figure.height_m * figure.girth * slice.half_depth * ahead,
                     Vector3d(0.0, figure.height_m * figure.girth * slice.half_width, 0.0)});
  add_tube(mesh, rings, figure.top);
}

void add_head(Mesh& mesh, const Figure& figure, const Stance& stance) {
  const double h = figure.height_m;
  const Vector3d neck = stance.hip + 0.32 * h * torso_axis(stance.lean_rad);
  // Who leans forward holds the head up.
  const Vector3d up = torso_axis(0.4 * stance.lean_rad);
  add_limb(mesh, {{neck, 0.030 * h}, {neck + 0.06 * h * up, 0.030 * h}}, Surface::kSkin, 6);
  const Vector3d middle = neck + 0.082 * h * up;
  // Half height, depth and width of a head: 0.068, 0.056 and 0.046 of the height.
  if (figure.helmet)
    add_ball(mesh, middle + Vector3d(0.0, 0.0, 0.01), {0.142, 0.125, 0.132}, Surface::kTrim);
  else
    add_ball(mesh, middle, {0.056 * h, 0.046 * h, 0.068 * h}, Surface::kSkin);
}

void add_foot(Mesh& mesh, const Figure& figure, const Vector3d& ankle, double toes_down_rad) {
  const double length = BodyShares::kFoot * figure.height_m;
  const double drop = BodyShares::kAnkle * figure.height_m;
  const Vector3d ahead(std::cos(toes_down_rad), 0.0, -std::sin(toes_down_rad));
  const Vector3d up(std::sin(toes_down_rad), 0.0, std::cos(toes_down_rad));
  const auto ring = [&](double forward, double half_height) {
    return Ring{ankle + forward * length * ahead - (drop - half_height) * up, half_height * up,
                Vector3d(0.0, 0.19 * length, 0.0)};
  };
  add_tube(mesh, {ring(-0.25, 0.65 * drop), ring(0.2, 0.75 * drop), ring(0.75, 0.35 * drop)},
           figure.shoes);
}

void add_leg(Mesh& mesh, const Figure& figure, const Stance& stance, std::size_t which) {
  const double h = figure.height_m;
  const double side = which == 0 ? 1.0 : -1.0;
  const Vector3d hip = stance.hip + Vector3d(0.5 * side * stance.hip_turn_m, 0.052 * side * h, 0.0);
  const Bend leg = bent(hip, stance.ankles.at(which),
                        {BodyShares::kThigh * h, BodyShares::kShank * h}, {1.0, 0.15 * side, 0.0});
  const double thick = figure.girth * h;
  add_limb(mesh, {{hip, 0.050 * thick}, {leg.middle, 0.034 * thick}, {leg.end, 0.025 * thick}},
           figure.trousers, 7);
  add_foot(mesh, figure, leg.end, stance.toes_down_rad.at(which));
}

void add_arm(Mesh& mesh, const Figure& figure, const Stance& stance, std::size_t which) {
  const double h = figure.height_m;
  const double side = which == 0 ? 1.0 : -1.0;
  const Vector3d shoulder = shoulders_of(figure, stance) +
                            Vector3d(0.0, side * BodyShares::kShoulderHalfWidth * h, -0.015 * h);
  const Bend arm =
      bent(shoulder, stance.wrists.at(which), {BodyShares::kUpperArm * h, BodyShares::kForearm * h},
           {-0.6, 0.5 * side, -0.4});
  const double thick = figure.girth * h;
  add_limb(mesh, {{shoulder, 0.032 * thick}, {arm.middle, 0.026 * thick}, {arm.end, 0.019 * thick}},
           figure.top, 6);
  const Vector3d fingers = arm.end + 0.09 * h * (arm.end - arm.middle).normalized();
  add_limb(mesh, {{arm.end, 0.018 * h}, {fingers, 0.020 * h}}, Surface::kSkin, 5);
}

void add_backpack(Mesh& mesh, const Figure& figure, const Stance& stance) {
  const double h = figure.height_m;
  const Vector3d up = torso_axis(stance.lean_rad);
  const Vector3d behind(-up.z(), 0.0, up.x());
  const Vector3d middle = shoulders_of(figure, stance) - 0.10 * h * up + 0.105 * h * behind;
  const auto ring = [&](double along, double half_depth, double half_width) {
    return Ring{middle + along * h * up, half_depth * h * behind,
                Vector3d(0.0, half_width * h, 0.0)};
  };
  add_tube(mesh,
           {ring(-0.13, 0.05, 0.075), ring(-0.06, 0.07, 0.09), ring(0.06, 0.06, 0.085),
            ring(0.12, 0.03, 0.06)},
           Material(Surface::kCloth, 0.6));
}

}  // namespace

Vector3d shoulders_of(const Figure& figure, const Stance& stance) {
  return stance.hip +
         (BodyShares::kShoulder - BodyShares::kHip) * figure.height_m * torso_axis(stance.lean_rad);
}

void add_person(Mesh& mesh, const Figure& figure, const Stance& stance) {
  add_torso(mesh, figure, stance);
  add_head(mesh, figure, stance);
  for (const std::size_t which : {0U, 1U}) {
    add_leg(mesh, figure, stance, which);
    add_arm(mesh, figure, stance, which);
  }
  if (figure.backpack) add_backpack(mesh, figure, stance);
}

Figure draw_figure(Random& random) {
  Figure figure;
  // Adults: mean of men and women in Europe, both sexes in one bell.
  figure.height_m = std::clamp(1.72 + 0.09 * random.normal(), 1.50, 1.95);
  figure.girth = std::clamp(1.08 + 0.13 * random.normal(), 0.85, 1.40);
  figure.top = Material(Surface::kCloth, random.uniform(0.4, 1.7));
  figure.trousers = Material(Surface::kCloth, random.uniform(0.3, 1.2));
  figure.shoes = Material(Surface::kCloth, random.uniform(0.2, 0.9));
  return figure;
}

void settle_together(std::vector<Mesh>& postures) {
  const Eigen::AlignedBox3f first = postures.front().bounds();
  for (Mesh& posture : postures) {
    const Eigen::Vector3f shift(first.center().x(), first.center().y(), posture.bounds().min().z());
    for (Eigen::Vector3f& vertex : posture.vertices) vertex -= shift;
  }
}

}  // namespace stillmap::simulation
