#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

#include "scenery/furniture.hpp"
#include "scenery/parts.hpp"
#include "scenery/sign_plates.hpp"

namespace stillmap::simulation {
namespace {

using Eigen::Vector3d;

/// The site reaches from -kHalfLength_m to kHalfLength_m along x, and to kHalfDepth_m on both
/// sides.
constexpr double kHalfLength_m = 6.0;
constexpr double kHalfDepth_m = 1.5;

Eigen::Isometry3d at(double x, double y, double turn_rad) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = Vector3d(x, y, 0.0);
  T.rotate(Eigen::AngleAxisd(turn_rad, Vector3d::UnitZ()));
  return T;
}

/// Red and white planks on two feet, along x.
Mesh make_barrier(double length_m) {
  Mesh mesh;
  constexpr double kStripe_m = 0.25;
  const int stripes = std::max(1, static_cast<int>(std::lround(length_m / kStripe_m)));
  const double step_m = length_m / stripes;
  for (const double z : {0.3, 0.85}) {
    for (int i = 0; i < stripes; ++i) {
      add_box(mesh, {step_m * i, -0.015, z}, {step_m * (i + 1), 0.015, z + (z < 0.5 ? 0.1 : 0.2)},
              {Surface::kFurniture, i % 2 == 0 ? 1.9 : 0.9});
    }
  }
  for (const double x : {0.2, length_m - 0.2}) {
    add_box(mesh, {x - 0.02, -0.04, 0.05}, {x + 0.02, -0.015, 1.05}, {Surface::kFurniture, 1.2});
    // Feet are slabs of recycled rubber.
    add_box(mesh, {x - 0.2, -0.4, 0.0}, {x + 0.2, 0.4, 0.11}, {Surface::kFurniture, 0.3});
  }
  return mesh;
}

/// Panel 3.5 m long and 2 m high, on blocks of concrete.
Mesh make_site_fence() {
  constexpr double kLength_m = 3.5;
  constexpr double kHigh_m = 2.0;
  Mesh mesh;
  mesh.add_quad({0.0, 0.0, 0.15}, {kLength_m, 0.0, 0.15}, {kLength_m, 0.0, kHigh_m},
                {0.0, 0.0, kHigh_m}, Surface::kMeshFence);
  for (const double x : {0.02, kLength_m - 0.02}) {
    add_bar(mesh, {x, 0.0, 0.05}, {x, 0.0, kHigh_m}, 0.021, Surface::kFence, 6);
    add_box(mesh, {x - 0.11, -0.35, 0.0}, {x + 0.11, 0.35, 0.14}, {Surface::kFurniture, 1.1});
  }
  for (const double z : {0.15, kHigh_m})
    add_bar(mesh, {0.0, 0.0, z}, {kLength_m, 0.0, z}, 0.015, Surface::kFence, 4);
  return mesh;
}

/// Round heap with the slope at which sand lies still, some 33 degrees.
Mesh make_heap(double radius_m, Random& random) {
  constexpr int kRings = 7;
  constexpr int kSides = 18;
  constexpr double kSlope = 0.65;
  std::vector<std::vector<Vector3d>> rings;
  for (int ring = 0; ring <= kRings; ++ring) {
    const double out = static_cast<double>(ring) / kRings;
    // Round on top, and as if poured at the foot.
    const double high_m = kSlope * radius_m * (1.0 - std::sqrt(out * out + 0.02)) - 0.02 * out;
    std::vector<Vector3d>& points = rings.emplace_back();
    for (int side = 0; side < kSides; ++side) {
      const double angle_rad = 2.0 * std::numbers::pi * side / kSides;
      const double bump_m = ring == kRings ? -0.1 : 0.05 * random.normal();
      const double away_m = radius_m * out * random.uniform(0.95, 1.0);
      points.emplace_back(away_m * std::cos(angle_rad), away_m * std::sin(angle_rad),
                          high_m + (ring == 0 ? 0.0 : bump_m));
    }
  }
  Mesh mesh;
  for (int ring = 0; ring < kRings; ++ring) {
    const auto& in = rings[static_cast<std::size_t>(ring)];
    const auto& out = rings[static_cast<std::size_t>(ring) + 1];
    for (std::size_t i = 0; i < kSides; ++i) {
      const std::size_t next = (i + 1) % kSides;
      mesh.add_quad(in[i], out[i], out[next], in[next], {Surface::kGravel, 1.3});
    }
  }
  return mesh;
}

/// Pipes in a heap of triangular section, along x.
Mesh make_pipes(double length_m, Random& random) {
  const double radius_m = random.uniform(0.08, 0.16);
  const int wide = 3 + static_cast<int>(random.index(2));
  const Material plastic(Surface::kFurniture, random.uniform(0.8, 1.7));
  Mesh mesh;
  for (int row = 0; row < wide - 1; ++row) {
    for (int i = 0; i < wide - row; ++i) {
      const double y = radius_m * (2.0 * i + row - (wide - 1));
      const double z = radius_m * (1.0 + std::numbers::sqrt3 * row);
      const double shift_m = random.uniform(-0.1, 0.1);
      for (const double share : {1.0, 0.88}) {
        add_bar(mesh, {shift_m - 0.5 * length_m, y, z}, {shift_m + 0.5 * length_m, y, z},
                share * radius_m, plastic, 10);
      }
    }
  }
  return mesh;
}

/// Small store container with ribbed walls.
Mesh make_store(Random& random) {
  constexpr double kLength_m = 2.99;
  constexpr double kWidth_m = 2.2;
  constexpr double kHigh_m = 2.26;
  const Material sheet(Surface::kContainer, random.uniform(0.6, 1.5));
  Mesh mesh;
  add_box(mesh, {-0.5 * kLength_m, -0.5 * kWidth_m, 0.1},
          {0.5 * kLength_m, 0.5 * kWidth_m, kHigh_m}, sheet);
  constexpr int kRibs = 10;
  for (int i = 0; i <= kRibs; ++i) {
    const double x = (kLength_m - 0.1) * (static_cast<double>(i) / kRibs - 0.5);
    for (const double y : {-0.5 * kWidth_m - 0.03, 0.5 * kWidth_m})
      add_box(mesh, {x - 0.05, y, 0.15}, {x + 0.05, y + 0.03, kHigh_m - 0.1}, sheet);
  }
  for (const double x : {-1.2, 1.2})
    add_box(mesh, {x - 0.1, -1.0, -0.05}, {x + 0.1, 1.0, 0.1}, {Surface::kFurniture, 0.8});
  return mesh;
}

/// Striped beacon, which stands in its foot and looks both ways.
Mesh make_beacon() {
  Mesh mesh;
  for (const double side : {-1.0, 1.0}) {
    add_board(mesh, {side * 0.02, 0.0, 0.65}, side * 0.125 * Vector3d::UnitY(),
              0.5 * Vector3d::UnitZ());
  }
  add_box(mesh, {-0.4, -0.2, 0.0}, {0.4, 0.2, 0.11}, {Surface::kFurniture, 0.3});
  add_box(mesh, {-0.015, -0.03, 0.1}, {0.015, 0.03, 1.1}, {Surface::kPole, 0.8});
  return mesh;
}

/// Warning sign in a foot that stands on the ground, looks to -x.
Mesh make_site_sign(Random& random) {
  Mesh mesh;
  const double low_m = random.uniform(0.6, 1.4);
  add_box(mesh, {-0.4, -0.2, 0.0}, {0.4, 0.2, 0.11}, {Surface::kFurniture, 0.3});
  add_bar(mesh, {0.0, 0.0, 0.1}, {0.0, 0.0, low_m + 0.8}, 0.02, Surface::kPole, 4);
  add_plate(mesh, random.chance(0.6) ? PlateShape::kWarning : PlateShape::kRound,
            {-0.03, 0.0, low_m});
  return mesh;
}

/// Fences at the back and at one end, barriers to the road and at the other end.
void enclose(Mesh& mesh, Random& random) {
  const Mesh fence = make_site_fence();
  for (int i = 0; i < 3; ++i)
    mesh.add(fence, at(-5.3 + 3.55 * i, kHalfDepth_m - 0.4, random.uniform(-0.03, 0.03)));
  const Mesh barrier = make_barrier(2.0);
  for (int i = 0; i < 5; ++i)
    mesh.add(barrier, at(-5.2 + 2.1 * i, 0.45 - kHalfDepth_m, random.uniform(-0.05, 0.05)));
  for (const double x : {-5.5, 5.5}) {
    mesh.add(make_barrier(1.6), at(x, -0.8, 0.5 * std::numbers::pi + random.uniform(-0.1, 0.1)));
  }
}

}  // namespace

Mesh make_building_site(Random& random) {
  Mesh mesh;
  enclose(mesh, random);
  // What is on it stands in three places in changing order.
  std::vector<double> places{-3.7, 0.0, 3.7};
  for (std::size_t i = places.size(); i-- > 1;) std::swap(places[i], places[random.index(i + 1)]);
  mesh.add(make_heap(random.uniform(0.9, 1.15), random), at(places[0], 0.0, 0.0));
  mesh.add(make_pipes(random.uniform(2.4, 3.4), random),
           at(places[1], 0.1, random.uniform(-0.05, 0.05)));
  if (random.chance(0.6)) {
    mesh.add(make_store(random), at(places[2], 0.0, 0.0));
  } else {
    mesh.add(make_heap(random.uniform(0.6, 0.9), random), at(places[2], 0.0, 0.0));
  }
  for (const double side : {-1.0, 1.0}) {
    const double ahead_rad = side < 0.0 ? 0.0 : std::numbers::pi;
    const double sign_m = side * (kHalfLength_m - 0.5);
    mesh.add(make_site_sign(random), at(sign_m, kHalfDepth_m - 0.3, ahead_rad));
    mesh.add(make_beacon(), at(side * (kHalfLength_m - 0.4), 0.3 - kHalfDepth_m, 0.0));
  }
  return mesh;
}

}  // namespace stillmap::simulation
