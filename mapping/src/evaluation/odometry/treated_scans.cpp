#include "evaluation/odometry/treated_scans.hpp"

#include <stillmap/mapping/projection.hpp>

#include <algorithm>
#include <utility>
#include <vector>

namespace stillmap::mapping {
namespace {

/// Scans that the ground stage learns from, as a build does.
constexpr std::size_t kScansToLearn = 10;

}  // namespace

TreatedScans::TreatedScans(const maps::Drive& drive, MovablePolicy policy,
                           const std::string& detector, std::span<const std::size_t> scans,
                           const CancelFlag& cancel)
    : drive_(drive), policy_(policy), counted_(drive.size()) {
  if (policy_ == MovablePolicy::kKeep) return;
  detector_ = make_detector(detector, drive.size());
  ground_ = make_ground_segmenter();
  const std::size_t learned = std::min(kScansToLearn, scans.size());
  for (std::size_t i = 0; i < learned; ++i) {
    if (cancel) throw Cancelled();
    const maps::Scan scan = drive_.read(scans[i * scans.size() / learned]);
    if (!scan.cloud.empty()) ground_->learn(scan.cloud);
  }
}

maps::Scan TreatedScans::read(std::size_t index) const {
  maps::Scan scan = drive_.read(index);
  const bool counts = !counted_[index].exchange(true);
  if (counts) in_ += scan.cloud.size();
  if (policy_ == MovablePolicy::kKeep || scan.cloud.empty()) return scan;
  const GroundResult ground = ground_->segment(scan.cloud);
  ProjectionOptions options;
  options.policy = policy_;
  options.ground_height = GroundHeight::kMean;
  ProjectionResult projection =
      project_objects(scan.cloud, ground, detector_->detect(scan, ground), options);
  if (counts) {
    projected_ += projection.projected;
    deleted_ += projection.deleted;
  }
  scan.cloud.positions = std::move(projection.positions);
  std::vector<std::uint8_t> keep(scan.cloud.size());
  for (std::size_t i = 0; i < keep.size(); ++i)
    keep[i] = projection.fates[i] != PointFate::kDeleted ? 1 : 0;
  scan.cloud.keep_only(keep);
  return scan;
}

TreatedPoints TreatedScans::points() const {
  return {.in = in_, .projected = projected_, .deleted = deleted_};
}

}  // namespace stillmap::mapping
