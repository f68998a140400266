#include "geometry/mesh.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace stillmap::simulation {
Material::Material(Surface s, double scale)
    : surface(s),
      brightness(static_cast<std::uint8_t>(std::lround(std::clamp(128.0 * scale, 0.0, 255.0)))) {}

void Mesh::add_triangle(const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                        const Eigen::Vector3d& c, Material material) {
  const auto first = static_cast<std::uint32_t>(vertices.size());
  for (const Eigen::Vector3d& corner : {a, b, c}) vertices.push_back(corner.cast<float>());
  triangles.push_back({first, first + 1, first + 2});
  materials.push_back(material);
}

void Mesh::add_quad(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c,
                    const Eigen::Vector3d& d, Material material) {
  const auto first = static_cast<std::uint32_t>(vertices.size());
  for (const Eigen::Vector3d& corner : {a, b, c, d}) vertices.push_back(corner.cast<float>());
  triangles.push_back({first, first + 1, first + 2});
  triangles.push_back({first, first + 2, first + 3});
  materials.insert(materials.end(), 2, material);
}

void Mesh::add_box(const Eigen::Isometry3d& T, const Eigen::Vector3d& low,
                   const Eigen::Vector3d& high, Material material) {
  const auto corner = [&](int i) {
    return Eigen::Vector3d(T * Eigen::Vector3d((i & 1) != 0 ? high.x() : low.x(),
                                               (i & 2) != 0 ? high.y() : low.y(),
                                               (i & 4) != 0 ? high.z() : low.z()));
  };
  constexpr std::array<std::array<int, 4>, 6> kFaces{
      {{0, 1, 3, 2}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 3, 7, 6}, {0, 2, 6, 4}, {1, 3, 7, 5}}};
  for (const auto& f : kFaces)
    add_quad(corner(f[0]), corner(f[1]), corner(f[2]), corner(f[3]), material);
}

void Mesh::add_column(const Eigen::Vector3d& foot, const Eigen::Vector3d& axis,
                      const std::array<double, 2>& radii, Material material, int sides) {
  const Eigen::Vector3d u = axis.unitOrthogonal();
  const Eigen::Vector3d v = axis.normalized().cross(u);
  const auto rim = [&](int side, double radius) {
    const double angle = 2.0 * std::numbers::pi * side / sides;
    return Eigen::Vector3d(foot + radius * (std::cos(angle) * u + std::sin(angle) * v));
  };
  for (int side = 0; side < sides; ++side) {
    const Eigen::Vector3d top = rim(side, radii[1]) + axis;
    const Eigen::Vector3d next_top = rim(side + 1, radii[1]) + axis;
    add_quad(rim(side, radii[0]), rim(side + 1, radii[0]), next_top, top, material);
    add_triangle(top, next_top, foot + axis, material);
  }
}

void Mesh::add(const Mesh& other, const Eigen::Isometry3d& T_here_other) {
  const auto first = static_cast<std::uint32_t>(vertices.size());
  const Eigen::Isometry3f T = T_here_other.cast<float>();
  for (const Eigen::Vector3f& v : other.vertices) vertices.emplace_back(T * v);
  for (const auto& t : other.triangles)
    triangles.push_back({first + t[0], first + t[1], first + t[2]});
  materials.insert(materials.end(), other.materials.begin(), other.materials.end());
}

Eigen::AlignedBox3f Mesh::bounds() const {
  Eigen::AlignedBox3f box;
  for (const Eigen::Vector3f& v : vertices) box.extend(v);
  return box;
}

}  // namespace stillmap::simulation
