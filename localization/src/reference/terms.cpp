#include "reference/terms.hpp"

#include "align/registration.hpp"

#include <stillmap/maps/frames.hpp>

#include <cmath>

namespace stillmap::localization {

std::vector<Term> pair_up(const MapPoints& map, std::span<const Eigen::Vector3f> points_lidar,
                          const Eigen::Isometry3d& T_local_lidar, float max_distance_m) {
  std::vector<Term> terms;
  terms.reserve(points_lidar.size());
  for (const Eigen::Vector3f& p : points_lidar) {
    const Eigen::Vector3d p_lidar = p.cast<double>();
    const Eigen::Vector3d p_local = T_local_lidar * p_lidar;
    const MapPoints::Point* point = map.nearest(p_local.cast<float>(), max_distance_m);
    if (point == nullptr) continue;
    const Eigen::Vector3d offset = p_local - point->position.cast<double>();
    terms.push_back({.p_lidar = p_lidar, .point = point, .offset = offset, .residual = offset});
  }
  return terms;
}

double size_m(const Eigen::Isometry3d& move) {
  return std::hypot(move.translation().norm(), kLeverM * maps::rotation_angle_rad(move.linear()));
}

}  // namespace stillmap::localization
