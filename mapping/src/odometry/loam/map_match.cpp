#include "odometry/loam/map_match.hpp"

#include <stillmap/maps/frames.hpp>

namespace stillmap::mapping::loam {
namespace {

/// Fewer correspondences do not make a pose.
constexpr std::size_t kMinMapCorrespondences = 50;
/// Reach of the weights [m]: what the match with the sweep before may be off by.
constexpr double kReachM = 0.3;

/// A surface of the odom frame in the lidar frame of `T`.
Surface seen_from(const Surface& surface, const Eigen::Isometry3d& T_odom_lidar) {
  Surface out = surface;
  out.point = T_odom_lidar.inverse(Eigen::Isometry) * surface.point;
  for (Eigen::Vector3d& n : out.normals) n = T_odom_lidar.linear().transpose() * n;
  return out;
}

std::vector<Correspondence> map_correspondences(const std::vector<Feature>& edges,
                                                const std::vector<Feature>& planes,
                                                const FeatureMaps& maps,
                                                const Eigen::Isometry3d& T_odom_lidar) {
  std::vector<Correspondence> out;
  out.reserve(edges.size() + planes.size());
  const auto add = [&](const Feature& f, const FeatureMap& map, const auto& fit) {
    const Eigen::Vector3d X = f.position.cast<double>();
    const Eigen::Vector3d q = T_odom_lidar * X;
    const FeatureMap::Neighbours near = map.nearest(q);
    if (near.count < kMapNeighbours) return;
    const auto surface = fit(near.span(), q);
    if (surface) out.push_back({X, {}, seen_from(*surface, T_odom_lidar)});
  };
  for (const Feature& f : edges) add(f, maps.edges, line_of);
  for (const Feature& f : planes) add(f, maps.planes, plane_of);
  return out;
}

}  // namespace

MapMatch match_map(const std::vector<Feature>& edges, const std::vector<Feature>& planes,
                   const FeatureMaps& maps, const MapMatch& before) {
  MapMatch match = before;
  const auto found = map_correspondences(edges, planes, maps, before.T_odom_lidar);
  if (found.size() < kMinMapCorrespondences) {
    match.settled = true;
    return match;
  }
  if (!match.told) match.told = told_by(found, Motion::Zero());
  const MotionFit fit = fit_motion(found, Motion::Zero(), *match.told, kReachM);
  match.T_odom_lidar = maps::renormalized(before.T_odom_lidar * isometry(fit.T));
  match.information = fit.information;
  match.variance_m2 = fit.variance_m2;
  match.inlier_ratio = static_cast<double>(inliers(found, fit.T)) /
                       static_cast<double>(edges.size() + planes.size());
  match.settled = fit.settled;
  return match;
}

}  // namespace stillmap::mapping::loam
