#pragma once

#include <Eigen/Geometry>

#include <array>
#include <cstdint>
#include <vector>

namespace stillmap::simulation {

/// What a triangle is made of: decides label, brightness and whether a ray comes back.
enum class Surface : std::uint8_t {
  kAsphalt,
  kPavement,
  kGrass,
  kWall,
  kWindow,
  kDoor,
  kRoof,
  kGardenWall,
  kHedge,
  kTrunk,
  kLeaf,
  kPole,
  kSign,
  kPaint,
  kCarGlass,
  kTyre,
  kCloth,
  kCount,
};

struct SurfaceProperties {
  /// SemanticKITTI class; what is a part of an object takes the object's instead.
  std::uint32_t label;
  /// Share of the light that comes back at normal incidence, in [0, 1].
  double reflectivity;
  /// Share of rays that are lost on it at any range (glass lets them through).
  double loss;
};
[[nodiscard]] const SurfaceProperties& properties_of(Surface surface);

/// Triangles with a surface each [m].
struct Mesh {
  std::vector<Eigen::Vector3f> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  std::vector<Surface> surfaces;

  void add_triangle(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c,
                    Surface surface);
  /// Corners in order around the face.
  void add_quad(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c,
                const Eigen::Vector3d& d, Surface surface);
  /// Faces of the box [low, high] of the frame `T`.
  void add_box(const Eigen::Isometry3d& T, const Eigen::Vector3d& low, const Eigen::Vector3d& high,
               Surface surface);
  /// Round column from `foot` along `axis` (its length is the column's), radius at foot and at top,
  /// closed on top.
  void add_column(const Eigen::Vector3d& foot, const Eigen::Vector3d& axis,
                  const std::array<double, 2>& radii, Surface surface);
};

}  // namespace stillmap::simulation
