#include "fusion/box_frames.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace stillmap::mapping {
namespace {

double turned_yaw(const Eigen::Matrix3d& R, double yaw_rad) {
  const Eigen::Vector3d heading = R * Eigen::Vector3d(std::cos(yaw_rad), std::sin(yaw_rad), 0.0);
  return std::atan2(heading.y(), heading.x());
}

double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

/// The part of a polygon to the left of the line from `a` to `b` (Sutherland, Hodgman, "Reentrant
/// Polygon Clipping", CACM 1974).
std::vector<Eigen::Vector2d> clipped(const std::vector<Eigen::Vector2d>& polygon,
                                     const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  std::vector<Eigen::Vector2d> kept;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Eigen::Vector2d& p = polygon[i];
    const Eigen::Vector2d& q = polygon[(i + 1) % polygon.size()];
    const double side_p = cross(b - a, p - a);
    const double side_q = cross(b - a, q - a);
    if (side_p >= 0.0) kept.push_back(p);
    if ((side_p > 0.0 && side_q < 0.0) || (side_p < 0.0 && side_q > 0.0))
      kept.emplace_back(p + (q - p) * (side_p / (side_p - side_q)));
  }
  return kept;
}

}  // namespace

maps::Box to_map(const maps::Box& box, const Eigen::Isometry3d& T_map_lidar) {
  maps::Box out = box;
  out.centre = T_map_lidar * box.centre;
  out.yaw_rad = turned_yaw(T_map_lidar.linear(), box.yaw_rad);
  return out;
}

maps::Box to_lidar(const maps::Box& box_map, const Eigen::Isometry3d& T_map_lidar) {
  maps::Box out = box_map;
  const Eigen::Matrix3d R_lidar_map = T_map_lidar.linear().transpose();
  out.centre = R_lidar_map * (box_map.centre - T_map_lidar.translation());
  out.yaw_rad = turned_yaw(R_lidar_map, box_map.yaw_rad);
  return out;
}

std::array<Eigen::Vector2d, 4> corners_of(const maps::Box& box) {
  const Eigen::Vector2d along(std::cos(box.yaw_rad), std::sin(box.yaw_rad));
  const Eigen::Vector2d across(-along.y(), along.x());
  const Eigen::Vector2d centre = box.centre.head<2>();
  const Eigen::Vector2d l = 0.5 * box.size_m.x() * along;
  const Eigen::Vector2d w = 0.5 * box.size_m.y() * across;
  return {centre + l + w, centre - l + w, centre - l - w, centre + l - w};
}

double shared_area_m2(const maps::Box& a, const maps::Box& b) {
  const double reach_m = 0.5 * (a.size_m.head<2>().norm() + b.size_m.head<2>().norm());
  if (!((a.centre - b.centre).head<2>().norm() < reach_m)) return 0.0;
  const auto of_a = corners_of(a);
  const auto of_b = corners_of(b);
  std::vector<Eigen::Vector2d> polygon(of_a.begin(), of_a.end());
  for (std::size_t i = 0; i < 4 && !polygon.empty(); ++i)
    polygon = clipped(polygon, of_b[i], of_b[(i + 1) % 4]);
  double twice_area = 0.0;
  for (std::size_t i = 2; i < polygon.size(); ++i)
    twice_area += cross(polygon[i - 1] - polygon[0], polygon[i] - polygon[0]);
  return 0.5 * twice_area;
}

BoxOverlap overlap_of(const maps::Box& a, const maps::Box& b) {
  const double shared_m2 = shared_area_m2(a, b);
  const double a_m2 = a.size_m.x() * a.size_m.y();
  const double b_m2 = b.size_m.x() * b.size_m.y();
  return {shared_m2 / (a_m2 + b_m2 - shared_m2), shared_m2 / std::min(a_m2, b_m2)};
}

}  // namespace stillmap::mapping
