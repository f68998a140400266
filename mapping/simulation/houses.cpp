#include <numbers>

#include "buildings.hpp"
#include "random.hpp"
#include "street.hpp"

namespace stillmap::simulation {
namespace {

/// A strip in front of a house or a gap, on one side of the street (+1 left, -1 right).
struct Plot {
  double begin = 0.0;
  double end = 0.0;
  double side = 1.0;
};

/// Wall or hedge along the pavement, in short pieces that follow the street; a gate stays open in
/// the middle.
void add_border(Mesh& mesh, const Road& road, const Plot& plot, Random& random) {
  constexpr double kPiece = 0.5;
  const bool hedge = random.chance(0.5);
  const double height = random.uniform(0.7, 1.6);
  const double thickness = hedge ? random.uniform(0.5, 0.9) : 0.22;
  const double gate = 0.5 * (plot.begin + plot.end);
  const double rough = hedge ? 0.08 : 0.0;
  for (double s = plot.begin + 0.2; s + kPiece < plot.end; s += kPiece) {
    // Drawn for the gate's pieces too, so that what follows does not hang on the gate's place.
    const double front = random.uniform(-rough, rough);
    const double top = height + random.uniform(-rough, rough);
    if (std::abs(s - gate) < 0.8) continue;
    const double d = plot.side * (StreetSection::kPavementEnd + 0.15);
    const double away = plot.side > 0.0 ? 0.0 : std::numbers::pi;
    mesh.add_box(road.T_world_upright(s + 0.5 * kPiece, d, away),
                 {-0.5 * kPiece - 0.02, front, -0.3}, {0.5 * kPiece + 0.02, thickness, top},
                 hedge ? Surface::kHedge : Surface::kGardenWall);
  }
}

void add_row(Mesh& mesh, const Road& road, std::uint64_t seed, double side) {
  Random random(key_of(seed, Stream::kBuildings, side > 0.0 ? 1 : 2));
  // Houses at the very end would have no ground below them.
  double s = road.begin_m() + 1.0;
  while (true) {
    BuildingShape shape;
    shape.width = random.uniform(8.0, 15.0);
    shape.depth = random.uniform(8.0, 12.0);
    shape.floors = 2 + static_cast<int>(random.index(4));
    const double set_back =
        random.chance(0.4) ? random.uniform(1.2, 1.6) : random.uniform(2.0, 5.0);
    const double gap = random.chance(0.55) ? random.uniform(1.5, 6.0) : random.uniform(0.1, 0.3);
    if (s + shape.width + gap > road.end_m() - 1.0) return;
    const double d = side * (StreetSection::kPavementEnd + set_back);
    const double turn = random.uniform(-0.03, 0.03) + (side > 0.0 ? 0.0 : std::numbers::pi);
    Random own(random.bits());
    add_building(mesh, road.T_world_upright(s + 0.5 * shape.width, d, turn), shape, own);
    if (set_back > 1.8) add_border(mesh, road, {s, s + shape.width, side}, own);
    if (gap > 1.0) add_border(mesh, road, {s + shape.width, s + shape.width + gap, side}, own);
    s += shape.width + gap;
  }
}

}  // namespace

void add_houses(Mesh& mesh, const Road& road, std::uint64_t seed) {
  for (const double side : {1.0, -1.0}) add_row(mesh, road, seed, side);
}

void add_poles(Mesh& mesh, const Road& road, std::uint64_t seed) {
  constexpr double kLampEvery = 28.0;
  constexpr double kFromKerb = 0.4;
  Random random(key_of(seed, Stream::kFurniture));
  double side = 1.0;
  for (double s = road.begin_m() + 5.0; s < road.end_m() - 5.0; s += kLampEvery, side = -side) {
    const double d = side * (StreetSection::kKerb + kFromKerb);
    const Eigen::Vector3d foot = road.surface(s, d) - Eigen::Vector3d(0.0, 0.0, 0.2);
    mesh.add_column(foot, {0.0, 0.0, 6.5}, {0.09, 0.06}, Surface::kPole);
    const Eigen::Vector3d arm = road.T_world_upright(s, d, 0.0).linear().col(1) * (-side * 1.4);
    mesh.add_column(foot + Eigen::Vector3d(0.0, 0.0, 6.4), arm, {0.04, 0.04}, Surface::kPole);
    const double sign_s = s + random.uniform(8.0, 20.0);
    const double sign_d = -side * (StreetSection::kKerb + kFromKerb);
    if (sign_s > road.end_m() - 5.0) continue;
    const Eigen::Isometry3d T = road.T_world_upright(sign_s, sign_d, random.uniform(-0.2, 0.2));
    mesh.add_column(T * Eigen::Vector3d(0.0, 0.0, -0.2), {0.0, 0.0, 2.8}, {0.035, 0.035},
                    Surface::kPole);
    mesh.add_box(T, {-0.06, -0.3, 2.0}, {-0.04, 0.3, 2.6}, Surface::kSign);
  }
}

}  // namespace stillmap::simulation
