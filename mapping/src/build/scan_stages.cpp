#include "build/scan_stages.hpp"

#include <stillmap/mapping/deskew.hpp>

#include <chrono>
#include <cmath>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Adds the time of a scope to a stage.
class StageTimer {
 public:
  StageTimer(std::map<std::string, double>& seconds, const char* stage)
      : seconds_(seconds[stage]), began_(std::chrono::steady_clock::now()) {}
  ~StageTimer() {
    seconds_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - began_).count();
  }
  StageTimer(const StageTimer&) = delete;
  StageTimer& operator=(const StageTimer&) = delete;

 private:
  double& seconds_;
  std::chrono::steady_clock::time_point began_;
};

/// Keeps the points within the range in place. Order is kept.
void keep_range(maps::PointCloud& cloud, const std::array<double, 2>& range_m,
                std::map<std::string, std::uint64_t>& counts) {
  const auto near2 = static_cast<float>(range_m[0] * range_m[0]);
  const auto far2 = static_cast<float>(range_m[1] * range_m[1]);
  std::uint64_t too_near = 0, too_far = 0;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const float range2 = cloud.positions[i].squaredNorm();
    if (range2 < near2) {
      ++too_near;
      continue;
    }
    if (range2 > far2) {
      ++too_far;
      continue;
    }
    cloud.positions[kept] = cloud.positions[i];
    if (!cloud.intensities.empty()) cloud.intensities[kept] = cloud.intensities[i];
    if (!cloud.time_offsets_s.empty()) cloud.time_offsets_s[kept] = cloud.time_offsets_s[i];
    ++kept;
  }
  cloud.positions.resize(kept);
  if (!cloud.intensities.empty()) cloud.intensities.resize(kept);
  if (!cloud.time_offsets_s.empty()) cloud.time_offsets_s.resize(kept);
  counts["dropped_too_near"] += too_near;
  counts["dropped_too_far"] += too_far;
}

maps::PointKind kind_of(PointFate fate) {
  switch (fate) {
    case PointFate::kGround:
      return maps::PointKind::kGround;
    case PointFate::kProjected:
      return maps::PointKind::kProjected;
    case PointFate::kKept:
    case PointFate::kDeleted:
      break;
  }
  return maps::PointKind::kMeasured;
}

double yaw_in_map(const Eigen::Isometry3d& T_map_lidar, double yaw_rad) {
  const Eigen::Vector3d heading =
      T_map_lidar.linear() * Eigen::Vector3d(std::cos(yaw_rad), std::sin(yaw_rad), 0.0);
  return std::atan2(heading.y(), heading.x());
}

std::vector<maps::MapObject> to_map(const std::vector<maps::Box>& boxes, std::size_t scan,
                                    const Eigen::Isometry3d& T_map_lidar) {
  std::vector<maps::MapObject> objects;
  objects.reserve(boxes.size());
  for (const maps::Box& box : boxes) {
    objects.push_back({.scan = scan,
                       .centre_map = T_map_lidar * box.centre,
                       .size_m = box.size_m,
                       .yaw_rad = yaw_in_map(T_map_lidar, box.yaw_rad),
                       .object_class = box.object_class,
                       .score = box.score,
                       .track = box.track});
  }
  return objects;
}

void collect(const maps::PointCloud& cloud, const ProjectionResult& projection,
             const Eigen::Isometry3d& T_map_lidar, ProcessedScan& out) {
  out.points.reserve(cloud.size());
  out.object_of_point.reserve(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const std::uint32_t object = projection.object_of_point[i];
    const PointFate fate = projection.fates[i];
    if (object != 0 && (fate == PointFate::kProjected || fate == PointFate::kDeleted))
      ++out.objects[object - 1].points_removed;
    if (fate == PointFate::kDeleted) continue;
    out.points.push_back({T_map_lidar * projection.positions[i].cast<double>(),
                          cloud.intensities.empty() ? 0.0F : cloud.intensities[i], kind_of(fate),
                          0});
    out.object_of_point.push_back(fate == PointFate::kProjected ? object : 0);
  }
}

}  // namespace

maps::Scan read_deskewed(const maps::Drive& drive, std::size_t index,
                         const std::array<double, 2>& range_m,
                         std::map<std::string, std::uint64_t>& counts) {
  maps::Scan scan = drive.read(index);
  keep_range(scan.cloud, range_m, counts);
  if (const auto twist = twist_at(drive, index)) deskew(scan.cloud, *twist);
  return scan;
}

ScanStages::ScanStages(const maps::Drive& drive, const MapBuildOptions& options)
    : drive_(drive),
      options_(options),
      ground_(make_ground_segmenter()),
      detector_(make_detector(options.detector, drive.size())) {}

ProcessedScan ScanStages::process(std::size_t index) const {
  ProcessedScan out;
  out.index = index;
  maps::Scan scan;
  {
    const StageTimer timer(out.stage_seconds, "read");
    out.sha256 = maps::sha256_of_file(drive_.contents().scan_files.at(index));
    scan = read_deskewed(drive_, index, {options_.min_range_m, options_.max_range_m}, out.counts);
  }
  out.counts["in"] = scan.points_in_file;
  out.counts["dropped_non_finite"] = scan.dropped.non_finite;
  out.counts["dropped_zero_range"] = scan.dropped.zero_range;
  out.counts["scans_empty"] = scan.cloud.empty() ? 1 : 0;
  if (scan.cloud.empty()) return out;
  GroundResult ground;
  {
    const StageTimer timer(out.stage_seconds, "ground");
    ground = ground_->segment(scan.cloud);
  }
  std::vector<maps::Box> boxes;
  if (options_.projection.policy != MovablePolicy::kKeep) {
    const StageTimer timer(out.stage_seconds, "detect");
    boxes = detector_->detect(scan, ground);
  }
  const StageTimer timer(out.stage_seconds, "project");
  const ProjectionResult projection =
      project_objects(scan.cloud, ground, boxes, options_.projection);
  out.counts["ground"] = projection.ground;
  out.counts["projected"] = projection.projected;
  out.counts["deleted"] = projection.deleted;
  out.counts["without_ground"] = projection.without_ground;
  const Eigen::Isometry3d& T_map_lidar = drive_.T_map_lidar(index);
  out.objects = to_map(boxes, index, T_map_lidar);
  collect(scan.cloud, projection, T_map_lidar, out);
  return out;
}

}  // namespace stillmap::mapping
