#include "reference/pcl_cloud.hpp"

#include <stillmap/maps/frames.hpp>

#include <pcl/filters/voxel_grid.h>

#include <cmath>
#include <stdexcept>
#include <utility>

namespace stillmap::mapping::reference {
namespace {

constexpr std::size_t kMinPoints = 10;

PclPoint point_at(const Eigen::Vector3f& p) { return {p.x(), p.y(), p.z()}; }

PclCloud::Ptr scan_cloud(const maps::PointCloud& scan_lidar) {
  PclCloud::Ptr cloud(new PclCloud);
  cloud->reserve(scan_lidar.size());
  for (const Eigen::Vector3f& p : scan_lidar.positions) {
    if (!p.allFinite()) throw std::invalid_argument("scan: a coordinate is not finite");
    cloud->push_back(point_at(p));
  }
  return cloud;
}

}  // namespace

PclCloud::Ptr thinned(const PclCloud::ConstPtr& cloud, double leaf_m) {
  pcl::VoxelGrid<PclPoint> grid;
  grid.setInputCloud(cloud);
  const auto leaf = static_cast<float>(leaf_m);
  grid.setLeafSize(leaf, leaf, leaf);
  PclCloud::Ptr out(new PclCloud);
  grid.filter(*out);
  return out;
}

PclMap map_for(const std::string& method, const std::vector<Eigen::Vector3d>& points_map,
               std::optional<double> leaf_m) {
  if (points_map.empty()) throw std::invalid_argument(method + ": the map has no measured point");
  PclMap map;
  for (const Eigen::Vector3d& p : points_map)
    map.origin += p / static_cast<double>(points_map.size());
  map.cloud.reset(new PclCloud);
  map.cloud->reserve(points_map.size());
  for (const Eigen::Vector3d& p : points_map)
    map.cloud->push_back(point_at((p - map.origin).cast<float>()));
  if (leaf_m) map.cloud = thinned(map.cloud, *leaf_m);
  map.tree.reset(new PclTree);
  map.tree->setInputCloud(map.cloud);
  return map;
}

std::optional<PclQuery> query_of(const maps::PointCloud& scan_lidar,
                                 const std::optional<localization::Prior>& given, const PclMap& map,
                                 double leaf_m, localization::AlignmentResult& answer) {
  if (!given) {
    answer.reasons = {localization::Reason::kNeedsPrior};
    return std::nullopt;
  }
  if (!given->T_map_lidar.matrix().allFinite()) throw std::invalid_argument("prior: not finite");
  const PclCloud::ConstPtr scan = scan_cloud(scan_lidar);
  answer.T_map_lidar = given->T_map_lidar;
  if (scan->size() < kMinPoints) {
    answer.reasons = {localization::Reason::kTooFewPoints};
    return std::nullopt;
  }
  Eigen::Isometry3d start = given->T_map_lidar;
  start.translation() -= map.origin;
  return PclQuery{thinned(scan, leaf_m), start.matrix().cast<float>()};
}

void run(pcl::Registration<PclPoint, PclPoint>& method, const PclQuery& query, const PclMap& map,
         double leaf_m, localization::AlignmentResult& answer) {
  PclCloud aligned;
  method.setInputSource(query.source);
  method.align(aligned, query.start);
  const Eigen::Isometry3d T(method.getFinalTransformation().cast<double>());
  if (!method.hasConverged() || !T.matrix().allFinite()) {
    answer.reasons = {localization::Reason::kNotConverged};
    return;
  }
  answer.T_map_lidar = maps::renormalized(T);
  answer.T_map_lidar.translation() += map.origin;
  answer.status = localization::PoseStatus::kOk;
  const auto leaf2 = static_cast<float>(leaf_m * leaf_m);
  std::size_t inliers = 0;
  double squares = 0.0;
  pcl::Indices index(1);
  std::vector<float> distance2(1);
  for (const PclPoint& p : aligned) {
    if (map.tree->nearestKSearch(p, 1, index, distance2) < 1 || distance2[0] > leaf2) continue;
    ++inliers;
    squares += static_cast<double>(distance2[0]);
  }
  answer.inlier_ratio = static_cast<double>(inliers) / static_cast<double>(aligned.size());
  answer.rmse_m = inliers == 0 ? 0.0 : std::sqrt(squares / static_cast<double>(inliers));
}

}  // namespace stillmap::mapping::reference
