#pragma once

#include <Eigen/Geometry>

#include "geometry/mesh.hpp"

namespace stillmap::simulation {

/// Upright rectangle on a wall, seen from outside: x to the right, z up [m].
struct WallRect {
  double left, right, low, high;

  [[nodiscard]] double middle() const { return 0.5 * (left + right); }
  [[nodiscard]] double width() const { return right - left; }
};

/// Draws on the outer face of a wall: x along it, y into the building, z up.
class WallPlane {
 public:
  WallPlane(Mesh& mesh, const Eigen::Isometry3d& T_world_wall, Material wall)
      : mesh_(&mesh), T_(T_world_wall), wall_(wall) {}

  /// The same wall, drawn from elsewhere in its frame: turned about z, then moved [rad, m].
  [[nodiscard]] WallPlane moved(const Eigen::Vector3d& to, double turn_rad = 0.0) const;
  /// The same wall of another material.
  [[nodiscard]] WallPlane with(Material wall) const {
    WallPlane plane = *this;
    plane.wall_ = wall;
    return plane;
  }
  [[nodiscard]] Material material() const { return wall_; }

  void quad(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c,
            const Eigen::Vector3d& d, Material material) const;
  void triangle(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c,
                Material material) const;
  void box(const Eigen::Vector3d& low, const Eigen::Vector3d& high, Material material) const;
  /// Round pipe or post between two points, of six sides.
  void pipe(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double radius_m,
            Material material) const;
  void upright(const WallRect& r, double y, Material material) const;
  void level(double left, double right, double near_y, double far_y, double z,
             Material material) const;
  /// Strip that stands out of the wall: front, top and underside; its ends are too small to see.
  void ledge(const WallRect& r, double out_m, Material material) const;
  /// Piece of wall with an opening in it, and the opening's reveals `depth_m` into the wall.
  void pierced(const WallRect& piece, const WallRect& opening, double depth_m) const;

 private:
  Mesh* mesh_;
  Eigen::Isometry3d T_;
  Material wall_;
};

}  // namespace stillmap::simulation
