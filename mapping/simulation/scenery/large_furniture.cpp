#include <algorithm>
#include <array>
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

constexpr double kLargeGround_m = -0.3;

/// Lattice girder from y = 0 to y = -length: four chords, struts in zigzag on all sides.
void add_girder(Mesh& mesh, double length_m, double low_m, const Eigen::Vector2d& size_m,
                Material material) {
  const int fields = std::max(2, static_cast<int>(std::lround(length_m / 1.4)));
  const double step_m = length_m / fields;
  const double half_m = 0.5 * size_m.x();
  const auto corner = [&](int side, int field) {
    const double x = side == 0 || side == 3 ? -half_m : half_m;
    return Vector3d(x, -step_m * field, side < 2 ? low_m : low_m + size_m.y());
  };
  for (int side = 0; side < 4; ++side) {
    add_bar(mesh, corner(side, 0), corner(side, fields), 0.07, material, 4);
    const int next = (side + 1) % 4;
    for (int field = 0; field < fields; ++field) {
      const bool up = (field + side) % 2 == 0;
      add_bar(mesh, corner(up ? side : next, field), corner(up ? next : side, field + 1), 0.03,
              material);
    }
  }
}

/// Boards over the lanes, the lower edges in one line; they look to +x.
void add_lane_boards(Mesh& mesh, double width_m, double low_m, double x, Random& random) {
  constexpr double kLane_m = 3.75;
  const int lanes = std::max(1, static_cast<int>(width_m / kLane_m));
  for (int lane = 0; lane < lanes; ++lane) {
    if (random.chance(0.15)) continue;
    const double half_m = 0.5 * random.uniform(2.6, 3.4);
    const double high_m = random.uniform(1.8, 2.8);
    const Vector3d middle(x, -width_m * (lane + 0.5) / lanes, low_m + 0.5 * high_m);
    add_board(mesh, middle, half_m * Vector3d::UnitY(), 0.5 * high_m * Vector3d::UnitZ());
    for (const double share : {-0.6, 0.6}) {
      const Vector3d foot = middle + Vector3d(-0.06, share * half_m, -0.5 * high_m);
      add_bar(mesh, foot, foot + high_m * Vector3d::UnitZ(), 0.04, Surface::kPole, 4);
    }
  }
}

/// Measures of a container after ISO 668 [m]; side walls are folded 36 mm deep every 0.28 m.
struct Container {
  double length_m, high_m;
};
constexpr double kWidth_m = 2.438;
constexpr double kFold_m = 0.036;
constexpr double kPitch_m = 0.278;

/// Folded sheet between two uprights, `in` leads to the inside.
void add_folded_wall(Mesh& mesh, const Vector3d& from, const Vector3d& to, const Vector3d& in,
                     double high_m, Material material) {
  const double length_m = (to - from).norm();
  const int folds = std::max(1, static_cast<int>(std::lround(length_m / kPitch_m)));
  const Vector3d step = (to - from) / folds;
  const Vector3d up = high_m * Vector3d::UnitZ();
  const std::array<Vector3d, 5> profile{Vector3d::Zero(), 0.25 * step, 0.5 * step + kFold_m * in,
                                        0.75 * step + kFold_m * in, step};
  for (int i = 0; i < folds; ++i) {
    const Vector3d at = from + i * step;
    for (std::size_t k = 0; k + 1 < profile.size(); ++k) {
      mesh.add_quad(at + profile.at(k), at + profile.at(k + 1), at + profile.at(k + 1) + up,
                    at + profile.at(k) + up, material);
    }
  }
}

/// Uprights, sills and rails that carry the walls.
void add_frame(Mesh& mesh, const Container& box, Material material) {
  const double x = 0.5 * box.length_m;
  const double y = 0.5 * kWidth_m;
  for (const double i : {-1.0, 1.0}) {
    for (const double k : {-1.0, 1.0}) {
      const Vector3d corner(i * x, k * y, 0.0);
      const Vector3d inner(i * (x - 0.15), k * (y - 0.1), box.high_m);
      add_box(mesh, corner.cwiseMin(inner), corner.cwiseMax(inner), material);
    }
    const double sill_m = i * (y - 0.06);
    add_box(mesh, {-x, std::min(i * y, sill_m), 0.0}, {x, std::max(i * y, sill_m), 0.16}, material);
    add_box(mesh, {-x, std::min(i * y, sill_m), box.high_m - 0.1},
            {x, std::max(i * y, sill_m), box.high_m - 0.02}, material);
    const double end_m = i * (x - 0.1);
    for (const double z : {0.0, box.high_m - 0.14}) {
      add_box(mesh, {std::min(i * x, end_m), -y, z}, {std::max(i * x, end_m), y, z + 0.12},
              material);
    }
  }
}

/// Two doors with locking rods at the end towards +x.
void add_doors(Mesh& mesh, const Container& box, Material material) {
  const double x = 0.5 * box.length_m - 0.05;
  const double y = 0.5 * kWidth_m - 0.1;
  const double low_m = 0.12;
  const double top_m = box.high_m - 0.14;
  mesh.add_quad({x, -y, low_m}, {x, y, low_m}, {x, y, top_m}, {x, -y, top_m}, material);
  for (const double share : {-0.75, -0.25, 0.25, 0.75}) {
    add_bar(mesh, {x + 0.04, share * y, low_m}, {x + 0.04, share * y, top_m}, 0.018,
            {Surface::kContainer, 1.4}, 4);
  }
}

Mesh make_container(const Container& box, Random& random) {
  const Material material(Surface::kContainer, random.uniform(0.4, 1.8));
  const double x = 0.5 * box.length_m - 0.12;
  const double y = 0.5 * kWidth_m - 0.02;
  const double wall_m = box.high_m - 0.24;
  Mesh walls;
  add_folded_wall(walls, {-x, -y, 0.0}, {x, -y, 0.0}, Vector3d::UnitY(), wall_m, material);
  add_folded_wall(walls, {-x, y, 0.0}, {x, y, 0.0}, -Vector3d::UnitY(), wall_m, material);
  add_folded_wall(walls, {-x - 0.05, -y, 0.0}, {-x - 0.05, y, 0.0}, Vector3d::UnitX(), wall_m,
                  material);
  Mesh mesh;
  add_frame(mesh, box, material);
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation().z() = 0.13;
  mesh.add(walls, T);
  add_doors(mesh, box, material);
  for (const double z : {0.1, box.high_m - 0.05})
    mesh.add_quad({-x, -y, z}, {x, -y, z}, {x, y, z}, {-x, y, z}, material);
  return mesh;
}

/// Containers of one layer, end to end: one long or two short ones.
void add_layer(Mesh& mesh, double low_m, const Container& box, Random& random) {
  constexpr Container kShort{6.058, 2.591};
  const bool halves = random.chance(0.35);
  for (const double side : {-1.0, 1.0}) {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    // Stacked with a crane, so to within some centimetres.
    const double aside_m = 0.01 * random.normal();
    T.translation() =
        Vector3d(halves ? side * 3.067 : aside_m, std::clamp(aside_m, -0.03, 0.03), low_m);
    if (random.chance(0.5)) T.rotate(Eigen::AngleAxisd(std::numbers::pi, Vector3d::UnitZ()));
    mesh.add(make_container(halves ? Container{kShort.length_m, box.high_m} : box, random), T);
    if (!halves) return;
  }
}

}  // namespace

Mesh make_gantry(double width_m, Random& random) {
  const double clear_m = random.uniform(5.2, 5.8);
  const Eigen::Vector2d size_m(0.8, random.uniform(0.9, 1.3));
  const Material steel(Surface::kPole, random.uniform(0.8, 1.2));
  Mesh mesh;
  for (const double y : {0.0, -width_m}) {
    add_box(mesh, {-0.5, y - 0.3, kLargeGround_m}, {0.5, y + 0.3, 0.3}, {Surface::kPole, 0.8});
    for (const double x : {-0.4, 0.4}) {
      add_box(mesh, {x - 0.11, y - 0.11, 0.3}, {x + 0.11, y + 0.11, clear_m + size_m.y()}, steel);
    }
    for (int i = 0; i < 3; ++i) {
      const double z = 0.5 + i * (clear_m - 0.5) / 3.0;
      const double rise_m = (clear_m - 0.5) / 3.0;
      const double way = i % 2 == 0 ? 0.4 : -0.4;
      add_bar(mesh, {-way, y, z}, {way, y, z + rise_m}, 0.04, steel, 4);
    }
  }
  add_girder(mesh, width_m, clear_m, size_m, steel);
  add_lane_boards(mesh, width_m, clear_m - 0.1, 0.55, random);
  return mesh;
}

Mesh make_container_stack(Random& random) {
  const std::size_t layers = 1 + random.index(3);
  Mesh mesh;
  double low_m = 0.0;
  for (std::size_t i = 0; i < layers; ++i) {
    // Of the usual height, or 1 ft higher.
    const Container box{12.192, random.chance(0.5) ? 2.591 : 2.896};
    add_layer(mesh, low_m, box, random);
    low_m += box.high_m;
  }
  return mesh;
}

}  // namespace stillmap::simulation
