// GCC 12 warns of Eigen's umeyama(), inlined here through PCL's headers: a false positive that the
// "system" mark of the headers does not cover, since the warning comes from the optimiser.
#pragma GCC diagnostic ignored "-Warray-bounds"

#include "reference/pcl_icp.hpp"

#include "reference/pcl_cloud.hpp"

#include <fmt/format.h>
#include <pcl/registration/icp.h>

#include <stdexcept>

namespace stillmap::mapping {

struct PclIcpAligner::Target {
  reference::PclMap map;
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
  target_ = std::make_unique<const Target>(
      Target{reference::map_for("pcl-icp", points_map, options.leaf_m)});
}

PclIcpAligner::~PclIcpAligner() = default;

localization::AlignmentResult PclIcpAligner::align(
    const maps::PointCloud& scan_lidar, const std::optional<localization::Prior>& given) const {
  localization::AlignmentResult answer;
  const auto query = reference::query_of(scan_lidar, given, target_->map, options_.leaf_m, answer);
  if (!query) return answer;
  pcl::IterativeClosestPoint<reference::PclPoint, reference::PclPoint> icp;
  icp.setInputTarget(target_->map.cloud);
  icp.setSearchMethodTarget(target_->map.tree, true);
  icp.setMaxCorrespondenceDistance(options_.max_pair_distance_m);
  icp.setMaximumIterations(options_.max_iterations);
  reference::run(icp, *query, target_->map, options_.leaf_m, answer);
  return answer;
}

}  // namespace stillmap::mapping
