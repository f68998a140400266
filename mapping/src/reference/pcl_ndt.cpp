// GCC 12 sees that Eigen's SVD, inlined here through PCL's headers, leaves its rank unset for a
// matrix that is not finite; points that are finite do not give one.
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"

#include "reference/pcl_ndt.hpp"

#include "reference/pcl_cloud.hpp"

#include <fmt/format.h>
#include <pcl/registration/ndt.h>

#include <mutex>
#include <stdexcept>

namespace stillmap::mapping {

struct PclNdtAligner::Target {
  reference::PclMap map;
  std::mutex mutex;
  pcl::NormalDistributionsTransform<reference::PclPoint, reference::PclPoint> ndt;
};

std::vector<std::string> PclNdtOptions::violations() const {
  std::vector<std::string> broken;
  if (!(leaf_m > 0.0)) broken.push_back(fmt::format("leaf_m: {}, > 0", leaf_m));
  if (!(cell_m > 0.0)) broken.push_back(fmt::format("cell_m: {}, > 0", cell_m));
  if (!(step > 0.0)) broken.push_back(fmt::format("step: {}, > 0", step));
  if (!(epsilon_m2 > 0.0)) broken.push_back(fmt::format("epsilon_m2: {}, > 0", epsilon_m2));
  if (max_iterations < 1) broken.push_back(fmt::format("max_iterations: {}, > 0", max_iterations));
  return broken;
}

PclNdtAligner::PclNdtAligner(const std::vector<Eigen::Vector3d>& points_map,
                             const PclNdtOptions& options)
    : options_(options) {
  const std::vector<std::string> broken = options.violations();
  if (!broken.empty()) throw std::invalid_argument(fmt::format("{}", fmt::join(broken, "; ")));
  target_ = std::make_unique<Target>();
  target_->map = reference::map_for("ndt", points_map, std::nullopt);
  auto& ndt = target_->ndt;
  // Before the target, whose cells would be made twice.
  ndt.setResolution(static_cast<float>(options.cell_m));
  ndt.setStepSize(options.step);
  ndt.setTransformationEpsilon(options.epsilon_m2);
  ndt.setMaximumIterations(options.max_iterations);
  ndt.setInputTarget(target_->map.cloud);
  // Its base class keeps a tree of the target as well, and would build it in the first alignment.
  ndt.setSearchMethodTarget(target_->map.tree, true);
}

PclNdtAligner::~PclNdtAligner() = default;

localization::AlignmentResult PclNdtAligner::align(
    const maps::PointCloud& scan_lidar, const std::optional<localization::Prior>& given) const {
  localization::AlignmentResult answer;
  const auto query = reference::query_of(scan_lidar, given, target_->map, options_.leaf_m, answer);
  if (!query) return answer;
  const std::lock_guard lock(target_->mutex);
  reference::run(target_->ndt, *query, target_->map, options_.leaf_m, answer);
  return answer;
}

}  // namespace stillmap::mapping
