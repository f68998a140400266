// GCC 12 warns of Eigen's umeyama(), inlined here through PCL's headers: see pcl_icp.cpp.
#pragma GCC diagnostic ignored "-Warray-bounds"

#include "reference/pcl_gicp.hpp"

#include "reference/pcl_cloud.hpp"

#include <fmt/format.h>
#include <pcl/registration/gicp.h>

#include <stdexcept>

namespace stillmap::mapping {
namespace {

using reference::PclPoint;
using Gicp = pcl::GeneralizedIterativeClosestPoint<PclPoint, PclPoint>;

/// PCL's own number of neighbours for a covariance; with fewer points it would read past them.
constexpr std::size_t kNeighbours = 20;

/// Lets the covariances of a map be computed once instead of in every alignment.
class GicpCovariances : public Gicp {
 public:
  static MatricesVectorPtr of(const reference::PclMap& map) {
    GicpCovariances gicp;
    MatricesVectorPtr covariances(new MatricesVector);
    gicp.computeCovariances<PclPoint>(map.cloud, map.tree, *covariances);
    return covariances;
  }
};

}  // namespace

struct PclGicpAligner::Target {
  reference::PclMap map;
  Gicp::MatricesVectorPtr covariances;
};

std::vector<std::string> PclGicpOptions::violations() const {
  std::vector<std::string> broken;
  if (!(leaf_m > 0.0)) broken.push_back(fmt::format("leaf_m: {}, > 0", leaf_m));
  if (!(max_pair_distance_m > 0.0)) {
    broken.push_back(fmt::format("max_pair_distance_m: {}, > 0", max_pair_distance_m));
  }
  if (max_iterations < 1) broken.push_back(fmt::format("max_iterations: {}, > 0", max_iterations));
  return broken;
}

PclGicpAligner::PclGicpAligner(const std::vector<Eigen::Vector3d>& points_map,
                               const PclGicpOptions& options)
    : options_(options) {
  const std::vector<std::string> broken = options.violations();
  if (!broken.empty()) throw std::invalid_argument(fmt::format("{}", fmt::join(broken, "; ")));
  Target target{reference::map_for("gicp", points_map, options.leaf_m), {}};
  if (target.map.cloud->size() < kNeighbours) {
    throw std::invalid_argument(
        fmt::format("gicp: {} points in the map after thinning, at least {}",
                    target.map.cloud->size(), kNeighbours));
  }
  target.covariances = GicpCovariances::of(target.map);
  target_ = std::make_unique<const Target>(std::move(target));
}

PclGicpAligner::~PclGicpAligner() = default;

localization::AlignmentResult PclGicpAligner::align(
    const maps::PointCloud& scan_lidar, const std::optional<localization::Prior>& given) const {
  localization::AlignmentResult answer;
  const auto query = reference::query_of(scan_lidar, given, target_->map, options_.leaf_m, answer);
  if (!query) return answer;
  if (query->source->size() < kNeighbours) {
    answer.reasons = {localization::Reason::kTooFewPoints};
    return answer;
  }
  Gicp gicp;
  gicp.setInputTarget(target_->map.cloud);
  gicp.setSearchMethodTarget(target_->map.tree, true);
  gicp.setTargetCovariances(target_->covariances);
  gicp.setMaxCorrespondenceDistance(options_.max_pair_distance_m);
  gicp.setMaximumIterations(options_.max_iterations);
  reference::run(gicp, *query, target_->map, options_.leaf_m, answer);
  return answer;
}

}  // namespace stillmap::mapping
