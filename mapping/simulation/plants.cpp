#include <cmath>
#include <numbers>

#include "random.hpp"
#include "street.hpp"

namespace stillmap::simulation {
namespace {

/// Crown of a plant: half axes and middle [m], and how many leaves of which size fill it.
struct Crown {
  Eigen::Vector3d middle;
  Eigen::Vector3d half_axes;
  int leaves;
  double leaf_m;
};

Eigen::Vector3d direction(Random& random) {
  const double z = random.uniform(-1.0, 1.0);
  const double angle = random.uniform(0.0, 2.0 * std::numbers::pi);
  const double r = std::sqrt(1.0 - z * z);
  return {r * std::cos(angle), r * std::sin(angle), z};
}

void add_crown(Mesh& mesh, const Crown& crown, Random& random) {
  for (int leaf = 0; leaf < crown.leaves; ++leaf) {
    // Leaves sit in the outer half, as they do.
    const double out = std::cbrt(random.uniform(0.15, 1.0));
    const Eigen::Vector3d p = crown.middle + out * crown.half_axes.cwiseProduct(direction(random));
    const Eigen::Vector3d u = direction(random);
    const Eigen::Vector3d v = u.cross(direction(random)).normalized();
    const double size = crown.leaf_m * random.uniform(0.6, 1.4);
    mesh.add_triangle(p, p + size * u, p + size * (0.5 * u + 0.8 * v), Surface::kLeaf);
  }
}

Mesh make_tree(Random& random) {
  constexpr int kLeaves = 1600;
  constexpr double kLeaf = 0.2;
  const double trunk = random.uniform(2.2, 3.2);
  const double radius = random.uniform(0.11, 0.22);
  const double spread = random.uniform(1.5, 2.4);
  const double tall = spread * random.uniform(0.9, 1.4);
  Mesh mesh;
  mesh.add_column({0.0, 0.0, -0.2}, {0.0, 0.0, trunk + 0.8}, {radius, 0.7 * radius},
                  Surface::kTrunk);
  for (int branch = 0; branch < 6; ++branch) {
    Eigen::Vector3d reach = direction(random);
    reach.z() = 0.6 + 0.4 * std::abs(reach.z());
    mesh.add_column({0.0, 0.0, trunk + 0.1 * branch}, 0.6 * spread * reach,
                    {0.3 * radius, 0.1 * radius}, Surface::kTrunk);
  }
  add_crown(mesh, {{0.0, 0.0, trunk + 0.75 * tall}, {spread, spread, tall}, kLeaves, kLeaf},
            random);
  return mesh;
}

Mesh make_bush(Random& random) {
  Mesh mesh;
  const double spread = random.uniform(0.5, 0.9);
  add_crown(mesh, {{0.0, 0.0, 0.5}, {spread, spread, random.uniform(0.5, 0.8)}, 350, 0.14}, random);
  return mesh;
}

}  // namespace

std::vector<Mesh> make_plants(std::uint64_t seed) {
  constexpr int kKinds = 4;
  std::vector<Mesh> shapes;
  for (int i = 0; i < kKinds; ++i) {
    Random random(key_of(seed, Stream::kPlants, static_cast<std::uint64_t>(i)));
    shapes.push_back(make_tree(random));
  }
  for (int i = 0; i < kKinds; ++i) {
    Random random(key_of(seed, Stream::kPlants, static_cast<std::uint64_t>(kKinds + i)));
    shapes.push_back(make_bush(random));
  }
  return shapes;
}

std::vector<Placement> place_plants(const Road& road, std::uint64_t seed,
                                    const std::vector<std::size_t>& trees,
                                    const std::vector<std::size_t>& bushes) {
  Random random(key_of(seed, Stream::kPlants, 1000));
  std::vector<Placement> plants;
  const auto place = [&](const std::vector<std::size_t>& kinds, double s, double d) {
    const std::size_t kind = kinds[random.index(kinds.size())];
    Eigen::Affine3d T(
        road.T_world_upright(s, d, random.uniform(0.0, 2.0 * std::numbers::pi)).matrix());
    T.scale(random.uniform(0.8, 1.2));
    plants.push_back({kind, T});
  };
  for (double s = road.begin_m() + 3.0; s < road.end_m() - 3.0; s += random.uniform(7.0, 13.0)) {
    const double side = random.sign();
    // On the pavement, by the kerb; and a bush or two in the gardens.
    if (random.chance(0.7)) place(trees, s, side * random.uniform(5.7, 5.9));
    for (const double garden : {1.0, -1.0}) {
      if (random.chance(0.5)) {
        place(bushes, s + random.uniform(0.0, 4.0), garden * random.uniform(9.0, 10.0));
      }
    }
  }
  return plants;
}

}  // namespace stillmap::simulation
