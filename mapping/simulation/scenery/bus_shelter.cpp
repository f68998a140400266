#include "scenery/furniture.hpp"
#include "scenery/parts.hpp"

namespace stillmap::simulation {
namespace {

using Eigen::Vector3d;

constexpr double kShelterGround_m = -0.3;
constexpr double kDepth_m = 1.45;
constexpr double kRoof_m = 2.35;

/// Upright pane with a frame of bars around it.
void add_pane(Mesh& mesh, const Vector3d& low, const Vector3d& along, double high_m,
              Material frame) {
  const Vector3d up(0.0, 0.0, high_m);
  mesh.add_quad(low, low + along, low + along + up, low + up, Surface::kWindow);
  add_bar(mesh, low, low + along, 0.02, frame, 4);
  add_bar(mesh, low + up, low + along + up, 0.02, frame, 4);
}

void add_seat(Mesh& mesh, double from_m, double to_m, Material material) {
  add_box(mesh, {from_m, kDepth_m - 0.5, 0.43}, {to_m, kDepth_m - 0.12, 0.47}, material);
  for (const double x : {from_m + 0.15, to_m - 0.15})
    add_bar(mesh, {x, kDepth_m - 0.3, 0.0}, {x, kDepth_m - 0.3, 0.43}, 0.03, material, 6);
}

}  // namespace

/// Open to the road; panes behind and at one end, an advertisement at the other.
Mesh make_bus_shelter(Random& random) {
  const int fields = random.chance(0.5) ? 3 : 2;
  const double field_m = random.uniform(1.25, 1.5);
  const double half_m = 0.5 * fields * field_m;
  const Material frame(Surface::kFurniture, random.uniform(0.5, 1.3));
  Mesh mesh;
  for (int i = 0; i <= fields; ++i) {
    const double x = -half_m + field_m * i;
    add_box(mesh, {x - 0.04, kDepth_m - 0.08, kShelterGround_m}, {x + 0.04, kDepth_m, kRoof_m},
            frame);
    if (i < fields) {
      add_pane(mesh, {x + 0.05, kDepth_m - 0.04, 0.2}, {field_m - 0.1, 0.0, 0.0}, 1.9, frame);
    }
  }
  for (const double x : {-half_m, half_m})
    add_box(mesh, {x - 0.04, 0.25, kShelterGround_m}, {x + 0.04, 0.33, kRoof_m}, frame);
  add_box(mesh, {-half_m - 0.15, 0.0, kRoof_m}, {half_m + 0.15, kDepth_m + 0.08, kRoof_m + 0.14},
          frame);
  add_pane(mesh, {-half_m, 0.35, 0.2}, {0.0, kDepth_m - 0.45, 0.0}, 1.9, frame);
  // Lit case with a poster.
  add_box(mesh, {half_m - 0.1, 0.1, 0.25}, {half_m + 0.1, kDepth_m - 0.1, 2.1},
          {Surface::kFurniture, 1.4});
  add_seat(mesh, -half_m + 0.3, half_m - random.uniform(0.6, 1.2), {Surface::kFurniture, 0.9});
  return mesh;
}

}  // namespace stillmap::simulation
