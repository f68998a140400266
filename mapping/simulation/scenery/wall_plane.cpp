#include "scenery/wall_plane.hpp"

namespace stillmap::simulation {

WallPlane WallPlane::moved(const Eigen::Vector3d& to, double turn_rad) const {
  WallPlane plane = *this;
  plane.T_ = T_ * Eigen::Translation3d(to) * Eigen::AngleAxisd(turn_rad, Eigen::Vector3d::UnitZ());
  return plane;
}

void WallPlane::quad(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c,
                     const Eigen::Vector3d& d, Material material) const {
  mesh_->add_quad(T_ * a, T_ * b, T_ * c, T_ * d, material);
}

void WallPlane::triangle(const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                         const Eigen::Vector3d& c, Material material) const {
  mesh_->add_triangle(T_ * a, T_ * b, T_ * c, material);
}

void WallPlane::box(const Eigen::Vector3d& low, const Eigen::Vector3d& high,
                    Material material) const {
  mesh_->add_box(T_, low, high, material);
}

void WallPlane::pipe(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double radius_m,
                     Material material) const {
  mesh_->add_column(T_ * from, T_.linear() * (to - from), {radius_m, radius_m}, material, 6);
}

void WallPlane::upright(const WallRect& r, double y, Material material) const {
  constexpr double kNothing = 1e-6;
  if (r.right - r.left < kNothing || r.high - r.low < kNothing) return;
  quad({r.left, y, r.low}, {r.right, y, r.low}, {r.right, y, r.high}, {r.left, y, r.high},
       material);
}

void WallPlane::level(double left, double right, double near_y, double far_y, double z,
                      Material material) const {
  quad({left, near_y, z}, {right, near_y, z}, {right, far_y, z}, {left, far_y, z}, material);
}

void WallPlane::ledge(const WallRect& r, double out_m, Material material) const {
  upright(r, -out_m, material);
  level(r.left, r.right, -out_m, 0.0, r.low, material);
  level(r.left, r.right, -out_m, 0.0, r.high, material);
}

void WallPlane::pierced(const WallRect& piece, const WallRect& opening, double depth_m) const {
  const WallRect& o = opening;
  upright({piece.left, o.left, piece.low, piece.high}, 0.0, wall_);
  upright({o.right, piece.right, piece.low, piece.high}, 0.0, wall_);
  upright({o.left, o.right, piece.low, o.low}, 0.0, wall_);
  upright({o.left, o.right, o.high, piece.high}, 0.0, wall_);
  for (const double x : {o.left, o.right})
    quad({x, 0, o.low}, {x, depth_m, o.low}, {x, depth_m, o.high}, {x, 0, o.high}, wall_);
  for (const double z : {o.low, o.high}) level(o.left, o.right, 0.0, depth_m, z, wall_);
}

}  // namespace stillmap::simulation
