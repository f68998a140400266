#include "detection/voxelnext/voxelnext_detector.hpp"

#include "detection/bev_overlap.hpp"
#include "detection/box_fit.hpp"
#include "detection/voxelnext/decoding.hpp"
#include "detection/voxelnext/voxels.hpp"

#include <algorithm>
#include <iterator>
#include <stdexcept>
#include <string>
#include <utility>

namespace stillmap::mapping {

namespace {

void check(const VoxelNextConfig& config) {
  std::size_t classes = 0;
  for (const VoxelNextHead& head : config.heads) classes += head.classes.size();
  if (config.iou_rectifier.size() != classes || config.calibration.size() != classes ||
      config.score_threshold.size() != classes) {
    throw std::invalid_argument(
        "voxelnext config: found " + std::to_string(config.iou_rectifier.size()) +
        " iou_rectifier, " + std::to_string(config.calibration.size()) + " calibration, " +
        std::to_string(config.score_threshold.size()) +
        " score_threshold, expected one for each of " + std::to_string(classes) + " classes");
  }
  for (const VoxelNextBranch branch :
       {VoxelNextBranch::kHm, VoxelNextBranch::kCenter, VoxelNextBranch::kCenterZ,
        VoxelNextBranch::kDim, VoxelNextBranch::kRot}) {
    if (std::find(config.branches.begin(), config.branches.end(), branch) == config.branches.end())
      throw std::invalid_argument("voxelnext config: no branch '" + std::string(name_of(branch)) +
                                  "'");
  }
}

std::vector<std::uint32_t> cells_of(const std::vector<Candidate>& candidates) {
  std::vector<std::uint32_t> out;
  for (const Candidate& candidate : candidates) {
    if (out.empty() || out.back() != candidate.cell) out.push_back(candidate.cell);
  }
  return out;
}

Voxels timed_voxels(const VoxelNextConfig& config, const maps::Scan& scan,
                    const NetworkHeight& height, const NetworkObserver& observer) {
  NetworkCosts::Part unused;
  NetworkCosts::Part& cost = observer.cost_of("voxels", unused);
  const Stopwatch stopwatch(cost.preparation);
  Voxels voxels = voxelize(config, scan.cloud, height);
  cost.sites = voxels.sites.size();
  return voxels;
}

}  // namespace

VoxelNextDetector::VoxelNextDetector(const VoxelNextWeights& weights)
    : config_(weights.config), network_(weights) {
  check(config_);
}

std::vector<maps::Box> VoxelNextDetector::detect(const maps::Scan& scan,
                                                 const GroundResult& ground) const {
  return detect(scan, ground, {});
}

std::vector<maps::Box> VoxelNextDetector::detect(const maps::Scan& scan, const GroundResult& ground,
                                                 const NetworkObserver& observer) const {
  const NetworkHeight height(config_, ground.surface.get());
  const VoxelNext::Neck neck =
      network_.backbone(timed_voxels(config_, scan, height, observer), observer);
  const std::vector<HeadMaps> maps = network_.heat_maps(neck, observer);
  std::vector<maps::Box> boxes;
  for (std::size_t head = 0; head < maps.size(); ++head) {
    const std::vector<Candidate> candidates =
        find_candidates(config_, head, neck.cells, maps[head].logits);
    const HeadBoxes at = network_.boxes(neck, head, cells_of(candidates), observer);
    std::ranges::move(decode_boxes(config_, head, candidates, neck.cells, at, height),
                      std::back_inserter(boxes));
  }
  if (config_.nms == VoxelNextSuppression::kMaxPool) return boxes;
  boxes = suppress_overlaps(std::move(boxes), config_.nms_iou);
  if (config_.nms == VoxelNextSuppression::kFitted) fit_to_points(boxes, scan.cloud);
  return boxes;
}

}  // namespace stillmap::mapping
