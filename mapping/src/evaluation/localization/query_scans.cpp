#include "evaluation/localization/query_scans.hpp"

#include <stillmap/mapping/deskew.hpp>
#include <stillmap/mapping/projection.hpp>

#include <algorithm>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

namespace stillmap::mapping {
namespace {

/// Scans that the ground stage learns from, as a build does.
constexpr std::size_t kLearnedScans = 10;

/// The cloud with its moved points where they went and without the deleted ones.
maps::PointCloud apply(maps::PointCloud cloud, ProjectionResult projection, QueryPoints& points) {
  points.projected += projection.projected;
  points.deleted += projection.deleted;
  points.without_ground += projection.without_ground;
  cloud.positions = std::move(projection.positions);
  std::vector<std::uint8_t> keep(cloud.size());
  for (std::size_t i = 0; i < keep.size(); ++i)
    keep[i] = projection.fates[i] != PointFate::kDeleted ? 1 : 0;
  cloud.keep_only(keep);
  return cloud;
}

}  // namespace

QueryScans::QueryScans(const maps::Drive& drive, const LocalizationEvaluationOptions& options,
                       const std::vector<std::size_t>& scans, const CancelFlag& cancel)
    : drive_(drive), deskew_(options.query_deskew), movable_(options.query_movable) {
  if (movable_ == MovablePolicy::kKeep) return;
  detector_ = make_detector(options.query_detector, drive.size());
  ground_ = make_ground_segmenter();
  const std::size_t learned = std::min(kLearnedScans, scans.size());
  for (std::size_t i = 0; i < learned; ++i) {
    if (cancel) throw Cancelled();
    const maps::Scan scan = read_for_query(scans[i * scans.size() / learned]);
    if (!scan.cloud.empty()) ground_->learn(scan.cloud);
  }
}

maps::Scan QueryScans::read_for_query(std::size_t index) const {
  maps::Scan scan = drive_.read(index);
  if (deskew_ == QueryDeskew::kVehicle) {
    const std::optional<Eigen::Matrix<double, 6, 1>> twist = twist_at(drive_, index);
    if (twist) deskew(scan.cloud, *twist);
  }
  if (deskew_ == QueryDeskew::kNone) scan.cloud.time_offsets_s.clear();
  return scan;
}

maps::PointCloud QueryScans::read(std::size_t index, QueryPoints& points) const {
  maps::Scan scan = read_for_query(index);
  points.in += scan.cloud.size();
  if (movable_ == MovablePolicy::kKeep || scan.cloud.empty()) return std::move(scan.cloud);
  const GroundResult ground = ground_->segment(scan.cloud);
  ProjectionOptions options;
  options.policy = movable_;
  ProjectionResult projection =
      project_objects(scan.cloud, ground, detector_->detect(scan, ground), options);
  return apply(std::move(scan.cloud), std::move(projection), points);
}

}  // namespace stillmap::mapping
