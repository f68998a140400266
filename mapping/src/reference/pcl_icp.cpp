// GCC 12 warns of Eigen's umeyama(), inlined here through PCL's headers: a false positive that the
// "system" mark of the headers does not cover, since the warning comes from the optimiser.
#pragma GCC diagnostic ignored "-Warray-bounds"

#include "reference/pcl_icp.hpp"

#include <stillmap/maps/frames.hpp>

#include <fmt/format.h>
#include <pcl/filters/voxel_grid.h>
#include <pcl/point_types.h>
#include <pcl/registration/icp.h>
#include <pcl/search/kdtree.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

using PclPoint = pcl::PointXYZ;
using PclCloud = pcl::PointCloud<PclPoint>;
using PclTree = pcl::search::KdTree<PclPoint>;

constexpr std::size_t kMinPoints = 10;

PclCloud::Ptr thinned(const PclCloud::ConstPtr& cloud, double leaf_m) {
  pcl::VoxelGrid<PclPoint> grid;
  grid.setInputCloud(cloud);
  const auto leaf = static_cast<float>(leaf_m);
  grid.setLeafSize(leaf, leaf, leaf);
  PclCloud::Ptr out(new PclCloud);
  grid.filter(*out);
  return out;
}

PclCloud::Ptr scan_cloud(const maps::PointCloud& scan_lidar) {
  PclCloud::Ptr cloud(new PclCloud);
  cloud->reserve(scan_lidar.size());
  for (const Eigen::Vector3f& p : scan_lidar.positions) {
    if (!p.allFinite()) throw std::invalid_argument("scan: a coordinate is not finite");
    cloud->push_back(PclPoint(p.x(), p.y(), p.z()));
  }
  return cloud;
}

}  // namespace

struct PclIcpAligner::Target {
  /// Added to PCL's float coordinates [m].
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  PclCloud::Ptr cloud;
  PclTree::Ptr tree;
};

std::vector<std::string> PclIcpOptions::violations() const {
  std::vector<std::string> broken;
  if (!(leaf_m > 0.0)) broken.push_back(fmt::format("leaf_m: {}, > 0", leaf_m));
  if (!(max_pair_distance_m > 0.0)) {
    broken.push_back(fmt::format("max_pair_distance_m: {}, > 0", max_pair_distance_m));
  }
  if (max_iterations < 1) broken.push_back(fmt::format("max_iterations: {}, > 0", max_iterations));
  return broken;
}

PclIcpAligner::PclIcpAligner(const std::vector<Eigen::Vector3d>& points_map,
                             const PclIcpOptions& options)
    : options_(options) {
  const std::vector<std::string> broken = options.violations();
  if (!broken.empty()) throw std::invalid_argument(fmt::format("{}", fmt::join(broken, "; ")));
  if (points_map.empty()) throw std::invalid_argument("pcl-icp: the map has no measured point");
  auto target = std::make_unique<Target>();
  for (const Eigen::Vector3d& p : points_map)
    target->origin += p / static_cast<double>(points_map.size());
  PclCloud::Ptr all(new PclCloud);
  all->reserve(points_map.size());
  for (const Eigen::Vector3d& p : points_map) {
    const Eigen::Vector3d q = p - target->origin;
    all->push_back(
        PclPoint(static_cast<float>(q.x()), static_cast<float>(q.y()), static_cast<float>(q.z())));
  }
  target->cloud = thinned(all, options.leaf_m);
  target->tree.reset(new PclTree);
  target->tree->setInputCloud(target->cloud);
  target_ = std::move(target);
}

PclIcpAligner::~PclIcpAligner() = default;

localization::AlignmentResult PclIcpAligner::align(
    const maps::PointCloud& scan_lidar, const std::optional<localization::Prior>& given) const {
  if (!given) {
    localization::AlignmentResult none;
    none.reasons = {"needs_prior"};
    return none;
  }
  const localization::Prior& prior = *given;
  if (!prior.T_map_lidar.matrix().allFinite()) throw std::invalid_argument("prior: not finite");
  const PclCloud::ConstPtr scan = scan_cloud(scan_lidar);
  localization::AlignmentResult result;
  result.T_map_lidar = prior.T_map_lidar;
  if (scan->size() < kMinPoints) {
    result.reasons = {"too_few_points"};
    return result;
  }
  const PclCloud::Ptr source = thinned(scan, options_.leaf_m);
  Eigen::Isometry3d guess = prior.T_map_lidar;
  guess.translation() -= target_->origin;
  pcl::IterativeClosestPoint<PclPoint, PclPoint> icp;
  icp.setInputSource(source);
  icp.setInputTarget(target_->cloud);
  icp.setSearchMethodTarget(target_->tree, true);
  icp.setMaxCorrespondenceDistance(options_.max_pair_distance_m);
  icp.setMaximumIterations(options_.max_iterations);
  PclCloud aligned;
  icp.align(aligned, guess.matrix().cast<float>());
  Eigen::Isometry3d T(icp.getFinalTransformation().cast<double>());
  if (!icp.hasConverged() || !T.matrix().allFinite()) {
    result.reasons = {"not_converged"};
    return result;
  }
  T = maps::renormalized(T);
  T.translation() += target_->origin;
  result.T_map_lidar = T;
  result.status = localization::PoseStatus::kOk;
  const auto leaf2 = static_cast<float>(options_.leaf_m * options_.leaf_m);
  std::size_t inliers = 0;
  double squares = 0.0;
  pcl::Indices index(1);
  std::vector<float> distance2(1);
  for (const PclPoint& p : aligned) {
    if (target_->tree->nearestKSearch(p, 1, index, distance2) < 1 || distance2[0] > leaf2) continue;
    ++inliers;
    squares += static_cast<double>(distance2[0]);
  }
  result.inlier_ratio = static_cast<double>(inliers) / static_cast<double>(aligned.size());
  result.rmse_m = inliers == 0 ? 0.0 : std::sqrt(squares / static_cast<double>(inliers));
  return result;
}

std::vector<std::string> map_aligner_names() {
  std::vector<std::string> names = localization::aligner_names();
  names.emplace_back("pcl-icp");
  return names;
}

std::unique_ptr<localization::Aligner> make_map_aligner(std::string_view method,
                                                        const maps::MapPackage& map) {
  const std::vector<std::string> ours = localization::aligner_names();
  if (std::find(ours.begin(), ours.end(), method) != ours.end()) {
    return localization::make_aligner(method, map);
  }
  if (method != "pcl-icp") {
    throw std::invalid_argument(fmt::format("method: found '{}', expected one of: {}", method,
                                            fmt::join(map_aligner_names(), ", ")));
  }
  std::vector<Eigen::Vector3d> points_map;
  for (const maps::TileEntry& entry : map.manifest().tiles) {
    if (entry.id.level != 0) continue;
    for (const maps::MapPoint& point : map.tile(entry.id)) {
      if (!maps::is_measured(point.kind)) continue;
      points_map.push_back(map.manifest().origin +
                           Eigen::Vector3f(point.x, point.y, point.z).cast<double>());
    }
  }
  return std::make_unique<PclIcpAligner>(points_map, PclIcpOptions{});
}

}  // namespace stillmap::mapping
