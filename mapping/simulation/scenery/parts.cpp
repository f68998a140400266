#include "scenery/parts.hpp"

#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace stillmap::simulation {

Eigen::Vector3d draw_direction(Random& random) {
  const double z = random.uniform(-1.0, 1.0);
  const double angle_rad = random.uniform(0.0, 2.0 * std::numbers::pi);
  const double r = std::sqrt(1.0 - z * z);
  return {r * std::cos(angle_rad), r * std::sin(angle_rad), z};
}

void add_bar(Mesh& mesh, const Eigen::Vector3d& from, const Eigen::Vector3d& to, double radius_m,
             Material material, int sides) {
  add_tube(mesh, {{from, radius_m}, {to, radius_m}}, material, sides);
}

void add_tube(Mesh& mesh, const std::vector<TubeRing>& rings, Material material, int sides) {
  const Eigen::Vector3d axis = (rings.back().middle - rings.front().middle).normalized();
  const Eigen::Vector3d u = axis.unitOrthogonal();
  const Eigen::Vector3d v = axis.cross(u);
  const auto corner = [&](std::size_t ring, int side) {
    const double angle_rad = 2.0 * std::numbers::pi * side / sides;
    // The lobes turn a little from ring to ring.
    const double swing = std::sin(3.0 * angle_rad + 0.4 * static_cast<double>(ring));
    const double radius_m = rings[ring].radius_m * (1.0 + rings[ring].lobes * swing);
    return Eigen::Vector3d(rings[ring].middle +
                           radius_m * (std::cos(angle_rad) * u + std::sin(angle_rad) * v));
  };
  for (std::size_t ring = 0; ring + 1 < rings.size(); ++ring) {
    for (int side = 0; side < sides; ++side) {
      mesh.add_quad(corner(ring, side), corner(ring, side + 1), corner(ring + 1, side + 1),
                    corner(ring + 1, side), material);
    }
  }
}

void add_tapered_box(Mesh& mesh, const Eigen::Isometry3d& T, const TaperedBox& box,
                     Material material) {
  constexpr std::array<std::array<double, 2>, 4> kCorners{{{-1, -1}, {1, -1}, {1, 1}, {-1, 1}}};
  const auto corner = [&](std::size_t i, const Eigen::Vector2d& size_m, double z) {
    const auto& side = kCorners[i % kCorners.size()];
    return Eigen::Vector3d(
        T * Eigen::Vector3d(0.5 * side[0] * size_m.x(), 0.5 * side[1] * size_m.y(), z));
  };
  for (std::size_t i = 0; i < kCorners.size(); ++i) {
    mesh.add_quad(corner(i, box.foot_m, box.low_m), corner(i + 1, box.foot_m, box.low_m),
                  corner(i + 1, box.top_m, box.high_m), corner(i, box.top_m, box.high_m), material);
  }
  for (const bool top : {false, true}) {
    const Eigen::Vector2d& size_m = top ? box.top_m : box.foot_m;
    const double z = top ? box.high_m : box.low_m;
    mesh.add_quad(corner(0, size_m, z), corner(1, size_m, z), corner(2, size_m, z),
                  corner(3, size_m, z), material);
  }
}

void add_box(Mesh& mesh, const Eigen::Vector3d& low, const Eigen::Vector3d& high,
             Material material) {
  mesh.add_box(Eigen::Isometry3d::Identity(), low, high, material);
}

void add_polygon(Mesh& mesh, const Eigen::Vector3d& middle, const Eigen::Vector3d& u,
                 const Eigen::Vector3d& v, int corners, Material material) {
  const auto corner = [&](int i) {
    const double angle_rad = 2.0 * std::numbers::pi * i / corners;
    return Eigen::Vector3d(middle + std::cos(angle_rad) * u + std::sin(angle_rad) * v);
  };
  for (int i = 1; i + 1 < corners; ++i)
    mesh.add_triangle(corner(0), corner(i), corner(i + 1), material);
}

}  // namespace stillmap::simulation
