#include "mesh.hpp"

#include <cmath>
#include <numbers>

namespace stillmap::simulation {
namespace {

constexpr std::array<SurfaceProperties, static_cast<std::size_t>(Surface::kCount)> kProperties{{
    {40, 0.20, 0.00},  // asphalt
    {48, 0.35, 0.00},  // pavement
    {72, 0.40, 0.00},  // grass
    {50, 0.45, 0.00},  // wall
    {50, 0.30, 0.60},  // window
    {50, 0.25, 0.00},  // door
    {50, 0.25, 0.00},  // roof
    {51, 0.40, 0.00},  // garden wall
    {70, 0.40, 0.00},  // hedge
    {71, 0.25, 0.00},  // trunk
    {70, 0.45, 0.00},  // leaf
    {80, 0.40, 0.00},  // pole
    {81, 0.95, 0.00},  // sign
    {10, 0.45, 0.03},  // paint
    {10, 0.15, 0.75},  // car glass
    {10, 0.08, 0.05},  // tyre
    {30, 0.40, 0.00},  // cloth
}};

}  // namespace

const SurfaceProperties& properties_of(Surface surface) {
  return kProperties.at(static_cast<std::size_t>(surface));
}

void Mesh::add_triangle(const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                        const Eigen::Vector3d& c, Surface surface) {
  const auto first = static_cast<std::uint32_t>(vertices.size());
  for (const Eigen::Vector3d& corner : {a, b, c}) vertices.push_back(corner.cast<float>());
  triangles.push_back({first, first + 1, first + 2});
  surfaces.push_back(surface);
}

void Mesh::add_quad(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c,
                    const Eigen::Vector3d& d, Surface surface) {
  const auto first = static_cast<std::uint32_t>(vertices.size());
  for (const Eigen::Vector3d& corner : {a, b, c, d}) vertices.push_back(corner.cast<float>());
  triangles.push_back({first, first + 1, first + 2});
  triangles.push_back({first, first + 2, first + 3});
  surfaces.insert(surfaces.end(), 2, surface);
}

void Mesh::add_box(const Eigen::Isometry3d& T, const Eigen::Vector3d& low,
                   const Eigen::Vector3d& high, Surface surface) {
  const auto corner = [&](int i) {
    return Eigen::Vector3d(T * Eigen::Vector3d((i & 1) != 0 ? high.x() : low.x(),
                                               (i & 2) != 0 ? high.y() : low.y(),
                                               (i & 4) != 0 ? high.z() : low.z()));
  };
  constexpr std::array<std::array<int, 4>, 6> kFaces{
      {{0, 1, 3, 2}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 3, 7, 6}, {0, 2, 6, 4}, {1, 3, 7, 5}}};
  for (const auto& f : kFaces)
    add_quad(corner(f[0]), corner(f[1]), corner(f[2]), corner(f[3]), surface);
}

void Mesh::add_column(const Eigen::Vector3d& foot, const Eigen::Vector3d& axis,
                      const std::array<double, 2>& radii, Surface surface) {
  constexpr int kSides = 12;
  const Eigen::Vector3d u = axis.unitOrthogonal();
  const Eigen::Vector3d v = axis.normalized().cross(u);
  const auto rim = [&](int side, double radius) {
    const double angle = 2.0 * std::numbers::pi * side / kSides;
    return Eigen::Vector3d(foot + radius * (std::cos(angle) * u + std::sin(angle) * v));
  };
  for (int side = 0; side < kSides; ++side) {
    const Eigen::Vector3d top = rim(side, radii[1]) + axis;
    const Eigen::Vector3d next_top = rim(side + 1, radii[1]) + axis;
    add_quad(rim(side, radii[0]), rim(side + 1, radii[0]), next_top, top, surface);
    add_triangle(top, next_top, foot + axis, surface);
  }
}

}  // namespace stillmap::simulation
