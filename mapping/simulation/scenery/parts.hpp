#pragma once

#include <Eigen/Geometry>

#include <vector>

#include "geometry/mesh.hpp"
#include "geometry/random.hpp"

/// Simple solids that plants, buildings and furniture are put together from.
namespace stillmap::simulation {

/// Bounds of a measure that is drawn evenly from between them.
struct Range {
  double low, high;
};
[[nodiscard]] inline double draw(const Range& range, Random& random) {
  return random.uniform(range.low, range.high);
}
/// Even over the sphere.
[[nodiscard]] Eigen::Vector3d draw_direction(Random& random);

/// Round bar without ends; three sides are enough for what is thinner than a laser's spot.
void add_bar(Mesh& mesh, const Eigen::Vector3d& from, const Eigen::Vector3d& to, double radius_m,
             Material material, int sides = 3);

struct TubeRing {
  Eigen::Vector3d middle;
  double radius_m;
  /// Share of the radius by which three lobes stand out (0: round).
  double lobes = 0.0;
};
/// Tube through the rings, without ends. Each ring lies across the line from the first ring to the
/// last, so the bends must be slight.
void add_tube(Mesh& mesh, const std::vector<TubeRing>& rings, Material material, int sides);

/// Box that widens or narrows upwards, around the z axis of the frame `T`.
struct TaperedBox {
  Eigen::Vector2d foot_m, top_m;
  double low_m, high_m;
};
void add_tapered_box(Mesh& mesh, const Eigen::Isometry3d& T, const TaperedBox& box,
                     Material material);

/// Box along the axes.
void add_box(Mesh& mesh, const Eigen::Vector3d& low, const Eigen::Vector3d& high,
             Material material);

/// Flat polygon around `middle` with its corners at equal angles, spanned by `u` and `v`.
void add_polygon(Mesh& mesh, const Eigen::Vector3d& middle, const Eigen::Vector3d& u,
                 const Eigen::Vector3d& v, int corners, Material material);

}  // namespace stillmap::simulation
