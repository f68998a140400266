#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "scenery/furniture.hpp"
#include "scenery/hedge.hpp"
#include "scenery/parts.hpp"

namespace stillmap::simulation {
namespace {

using Eigen::Vector3d;

constexpr double kBorderGround_m = -0.4;

struct Measures {
  double length_m, height_m;
};

/// Parts of equal length at most `most_m` long.
int parts_of(double length_m, double most_m) {
  return std::max(1, static_cast<int>(std::ceil(length_m / most_m - 1e-6)));
}

Mesh make_wall(const Measures& size, Random& random) {
  constexpr double kThick_m = 0.24;
  const double coping_m = size.height_m - 0.06;
  Mesh mesh;
  add_box(mesh, {0.0, 0.03, kBorderGround_m}, {size.length_m, 0.03 + kThick_m, coping_m},
          {Surface::kGardenWall, random.uniform(0.8, 1.2)});
  // The coping stands over and slopes to both sides.
  const Material stone(Surface::kGardenWall, 1.3);
  const double back_m = kThick_m + 0.06;
  add_box(mesh, {0.0, 0.0, coping_m}, {size.length_m, back_m, coping_m + 0.035}, stone);
  const Vector3d along(size.length_m, 0.0, 0.0);
  const Vector3d ridge(0.0, 0.5 * back_m, size.height_m);
  for (const double y : {0.0, back_m}) {
    const Vector3d eave(0.0, y, coping_m + 0.035);
    mesh.add_quad(eave, eave + along, ridge + along, ridge, stone);
  }
  return mesh;
}

/// Posts of a fence at the start of each of its fields; the next piece has the one at the end.
void add_posts(Mesh& mesh, const Measures& size, int fields, double thick_m, Material material) {
  for (int i = 0; i < fields; ++i) {
    const double x = size.length_m * i / fields;
    add_box(mesh, {x, 0.03, kBorderGround_m}, {x + thick_m, 0.03 + thick_m, size.height_m},
            material);
  }
}

/// Pales of about 7 cm with gaps of 4 to 6 cm, pointed on top, on two rails.
Mesh make_picket_fence(const Measures& size, Random& random) {
  const Material wood(Surface::kFence, random.uniform(0.6, 1.6));
  const double gap_m = random.uniform(0.04, 0.06);
  const double pale_m = 0.07;
  const int pales = std::max(2, static_cast<int>(std::lround(size.length_m / (pale_m + gap_m))));
  Mesh mesh;
  add_posts(mesh, {size.length_m, size.height_m - 0.08}, parts_of(size.length_m, 2.5), 0.09, wood);
  for (const double share : {0.25, 0.8}) {
    const double z = share * size.height_m;
    add_box(mesh, {0.0, 0.022, z - 0.035}, {size.length_m, 0.05, z + 0.035}, wood);
  }
  for (int i = 0; i < pales; ++i) {
    const double x = (i + 0.5) * size.length_m / pales;
    const double top_m = size.height_m - random.uniform(0.0, 0.015);
    const double shoulder_m = top_m - 0.05;
    const Vector3d half(0.5 * pale_m, 0.0, 0.0);
    add_box(mesh, Vector3d(x, 0.0, 0.06) - half, Vector3d(x, 0.02, shoulder_m) + half, wood);
    for (const double y : {0.0, 0.02}) {
      const Vector3d shoulder(x, y, shoulder_m);
      mesh.add_triangle(shoulder - half, shoulder + half, {x, y, top_m}, wood);
    }
  }
  // Its highest point is where it was asked for, whatever was drawn above.
  add_box(mesh, {0.0, 0.03, size.height_m - 0.09}, {0.09, 0.12, size.height_m}, wood);
  return mesh;
}

/// Iron bars every 11 cm between two rails.
Mesh make_railing(const Measures& size, Random& random) {
  const Material iron(Surface::kFence, random.uniform(0.3, 0.9));
  constexpr double kBar_m = 0.007;
  constexpr double kMiddle_m = 0.05;
  const int bars = parts_of(size.length_m, 0.11);
  Mesh mesh;
  add_posts(mesh, size, parts_of(size.length_m, 2.5), 0.04, iron);
  for (const double z : {0.1, size.height_m - 0.12}) {
    add_box(mesh, {0.0, kMiddle_m - 0.006, z - 0.02}, {size.length_m, kMiddle_m + 0.006, z + 0.02},
            iron);
  }
  for (int i = 0; i < bars; ++i) {
    const double x = (i + 0.5) * size.length_m / bars;
    add_bar(mesh, {x, kMiddle_m, 0.06}, {x, kMiddle_m, size.height_m}, kBar_m, iron);
  }
  return mesh;
}

/// The mesh is one sheet that lets most rays through.
Mesh make_mesh_fence(const Measures& size, Random& random) {
  const Material post(Surface::kFence, random.uniform(0.5, 1.2));
  constexpr double kMiddle_m = 0.05;
  const int fields = parts_of(size.length_m, 2.5);
  Mesh mesh;
  for (int i = 0; i < fields; ++i) {
    const double x = 0.025 + size.length_m * i / fields;
    mesh.add_column({x, kMiddle_m, kBorderGround_m}, {0.0, 0.0, size.height_m - kBorderGround_m},
                    {0.025, 0.025}, post, 8);
  }
  mesh.add_quad({0.0, kMiddle_m, 0.03}, {size.length_m, kMiddle_m, 0.03},
                {size.length_m, kMiddle_m, size.height_m - 0.02},
                {0.0, kMiddle_m, size.height_m - 0.02}, Surface::kMeshFence);
  for (const double z : {0.04, size.height_m - 0.02})
    add_bar(mesh, {0.0, kMiddle_m, z}, {size.length_m, kMiddle_m, z}, 0.012, post);
  return mesh;
}

/// Beam folded like a lying W, 0.31 m high and 81 mm deep (EN 1317 systems, profile A), on posts
/// every 2 m.
Mesh make_guard_rail(const Measures& size) {
  constexpr std::array<std::array<double, 2>, 9> kProfile{{{0.081, 0.0},
                                                           {0.06, 0.02},
                                                           {0.0, 0.06},
                                                           {0.0, 0.1},
                                                           {0.07, 0.155},
                                                           {0.0, 0.21},
                                                           {0.0, 0.25},
                                                           {0.06, 0.29},
                                                           {0.081, 0.31}}};
  const double low_m = size.height_m - kProfile.back()[1];
  const Vector3d along(size.length_m, 0.0, 0.0);
  const auto point = [&](std::size_t i) {
    return Vector3d(0.0, kProfile.at(i)[0], low_m + kProfile.at(i)[1]);
  };
  Mesh mesh;
  for (std::size_t i = 0; i + 1 < kProfile.size(); ++i) {
    mesh.add_quad(point(i), point(i) + along, point(i + 1) + along, point(i + 1),
                  Surface::kGuardRail);
  }
  const int posts = parts_of(size.length_m, 2.0);
  for (int i = 0; i < posts; ++i) {
    const double x = (i + 0.5) * size.length_m / posts;
    // C-shaped post, and the spacer between it and the beam.
    add_box(mesh, {x - 0.03, 0.2, kBorderGround_m}, {x + 0.03, 0.3, size.height_m - 0.06},
            Surface::kGuardRail);
    add_box(mesh, {x - 0.02, 0.08, low_m + 0.1}, {x + 0.02, 0.2, low_m + 0.21},
            Surface::kGuardRail);
  }
  return mesh;
}

/// Ribbed panels half a metre high between H-shaped steel posts every 4 m.
Mesh make_noise_wall(const Measures& size, Random& random) {
  const Material panel(Surface::kGardenWall, random.uniform(0.7, 1.4));
  const Material steel(Surface::kGardenWall, 0.9);
  const int fields = parts_of(size.length_m, 4.0);
  const int rows = parts_of(size.height_m, 0.5);
  Mesh mesh;
  for (int i = 0; i < fields; ++i) {
    const double from_m = size.length_m * i / fields;
    const double to_m = size.length_m * (i + 1) / fields;
    add_box(mesh, {from_m, 0.0, kBorderGround_m}, {from_m + 0.16, 0.18, size.height_m}, steel);
    add_box(mesh, {from_m + 0.16, 0.06, kBorderGround_m}, {to_m, 0.16, size.height_m - 0.03},
            panel);
    for (int row = 0; row < rows; ++row) {
      // The upper part of each panel stands out, which leaves a groove below.
      const double low_m = (size.height_m - 0.03) * row / rows;
      const double high_m = (size.height_m - 0.03) * (row + 1) / rows;
      add_box(mesh, {from_m + 0.16, 0.03, low_m + 0.06}, {to_m, 0.06, high_m - 0.02}, panel);
    }
  }
  return mesh;
}

}  // namespace

Mesh make_border_piece(BorderKind kind, double length_m, double height_m, Random& random) {
  const Measures size{length_m, height_m};
  switch (kind) {
    case BorderKind::kHedge:
      return make_hedge(length_m, height_m, random);
    case BorderKind::kPicketFence:
      return make_picket_fence(size, random);
    case BorderKind::kRailing:
      return make_railing(size, random);
    case BorderKind::kMeshFence:
      return make_mesh_fence(size, random);
    case BorderKind::kGuardRail:
      return make_guard_rail(size);
    case BorderKind::kNoiseWall:
      return make_noise_wall(size, random);
    case BorderKind::kWall:
      break;
  }
  return make_wall(size, random);
}

}  // namespace stillmap::simulation
