#pragma once

#include <vector>

#include "geometry/mesh.hpp"

namespace stillmap::simulation {

/// An ellipse across a tube: points centre + cos(a) u + sin(a) v.
struct Ring {
  Eigen::Vector3d centre;
  Eigen::Vector3d u;
  Eigen::Vector3d v;
};

/// Skin around the rings in order, closed at both ends.
void add_tube(Mesh& mesh, const std::vector<Ring>& rings, Material material, int sides = 8);

/// Where an arm, a leg or a pipe passes, and how thick it is there [m].
struct Joint {
  Eigen::Vector3d centre;
  double radius_m;
};
/// Round tube through at least two joints, closed at both ends.
void add_limb(Mesh& mesh, const std::vector<Joint>& joints, Material material, int sides = 8);

/// Ellipsoid with axes along x, y and z.
void add_ball(Mesh& mesh, const Eigen::Vector3d& centre, const Eigen::Vector3d& radii,
              Material material, int sides = 8);

/// Box with its sides along the axes.
void add_block(Mesh& mesh, const Eigen::Vector3d& low, const Eigen::Vector3d& high,
               Material material);

/// A wheel with a disc in it [m].
struct Wheel {
  double radius_m = 0.31;
  double width_m = 0.21;
  double rim_radius_m = 0.21;
  /// Whether every other sector of the disc is dark, as between the spokes of a cast rim.
  bool spokes = false;
};
/// `face` is the middle of the wheel's outer side; `side` is 1 when that looks to the left, else
/// -1. One corner of the tread is the lowest point.
void add_wheel(Mesh& mesh, const Eigen::Vector3d& face, double side, const Wheel& wheel);

/// Moves a mesh onto z = 0, with the middle of its footprint at the origin.
void settle(Mesh& mesh);

}  // namespace stillmap::simulation
