#pragma once

#include <Eigen/Geometry>

#include <array>
#include <cstdint>
#include <vector>

#include "geometry/surface.hpp"

namespace stillmap::simulation {

/// What a triangle is made of, and how bright that is against the surface's usual reflectivity.
struct Material {
  Surface surface = Surface::kWall;
  /// In 1/128: 128 leaves the reflectivity as it is, 64 halves it.
  std::uint8_t brightness = 128;

  // Not explicit: most triangles have the usual brightness.
  Material(Surface s) : surface(s) {}  // NOLINT(google-explicit-constructor)
  /// @param scale  against the usual reflectivity, in [0, 1.99].
  Material(Surface s, double scale);
};

/// Triangles with a material each [m]. Their sides do not matter: rays meet both.
struct Mesh {
  std::vector<Eigen::Vector3f> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  std::vector<Material> materials;

  void add_triangle(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c,
                    Material material);
  /// Corners in order around the face.
  void add_quad(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c,
                const Eigen::Vector3d& d, Material material);
  /// Faces of the box [low, high] of the frame `T`.
  void add_box(const Eigen::Isometry3d& T, const Eigen::Vector3d& low, const Eigen::Vector3d& high,
               Material material);
  /// Round column from `foot` along `axis` (its length is the column's), radius at foot and at top,
  /// closed on top.
  void add_column(const Eigen::Vector3d& foot, const Eigen::Vector3d& axis,
                  const std::array<double, 2>& radii, Material material, int sides = 12);
  /// Another mesh, moved there.
  void add(const Mesh& other, const Eigen::Isometry3d& T_here_other);

  [[nodiscard]] Eigen::AlignedBox3f bounds() const;
};

}  // namespace stillmap::simulation
