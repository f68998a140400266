#include "pipeline/scan_work.hpp"

#include "cleaning/buried_points.hpp"
#include "cleaning/unconfirmed_points.hpp"
#include "core/ordered_pipeline.hpp"
#include "fusion/box_frames.hpp"
#include "pipeline/boxes_files.hpp"
#include "views/weather_returns.hpp"

#include <fmt/format.h>

#include <stillmap/maps/map_package.hpp>

#include <algorithm>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Scans that the ground stage learns from: its published adaptation settles within some ten.
constexpr std::size_t kLearnedScans = 10;

maps::PointKind kind_of(PointFate fate) {
  switch (fate) {
    case PointFate::kGround:
      return maps::PointKind::kGround;
    case PointFate::kProjected:
      return maps::PointKind::kProjected;
    case PointFate::kKept:
    case PointFate::kDeleted:
    case PointFate::kDropped:
      break;
  }
  return maps::PointKind::kMeasured;
}

/// With several drives each has a file of boxes of its own.
std::string detector_of_drive(const std::string& spec, std::size_t drive, std::size_t drives) {
  const std::vector<std::filesystem::path> files = boxes_files(spec);
  if (files.empty() || drives == 1) return spec;
  if (files.size() != drives)
    throw std::invalid_argument(
        fmt::format("detector: found {} files of boxes, expected one for each of {} drives",
                    files.size(), drives));
  return "boxes:" + files[drive].string();
}

/// What a user wants to stay is where it was measured. @return points that were moved or deleted.
std::size_t put_back(const maps::PointCloud& cloud, const std::vector<bool>& is_ground,
                     const std::vector<maps::Box>& kept, ProjectionResult& projection) {
  std::size_t count = 0;
  if (kept.empty()) return count;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    PointFate& fate = projection.fates[i];
    const bool projected = fate == PointFate::kProjected;
    if (!projected && fate != PointFate::kDeleted) continue;
    const bool stays = std::any_of(kept.begin(), kept.end(), [&](const maps::Box& box) {
      return box.contains(cloud.positions[i].cast<double>());
    });
    if (!stays) continue;
    --(projected ? projection.projected : projection.deleted);
    projection.positions[i] = cloud.positions[i];
    fate = is_ground[i] ? PointFate::kGround : PointFate::kKept;
    ++count;
  }
  return count;
}

/// Takes points out of a scan. @param out  N flags, true = goes.
void take_out(const std::vector<bool>& out, maps::Scan& scan) {
  std::vector<std::uint8_t> keep(out.size());
  for (std::size_t i = 0; i < keep.size(); ++i) keep[i] = out[i] ? 0 : 1;
  scan.cloud.keep_only(keep);
}

void take_out_weather(maps::Scan& scan) {
  const std::vector<bool> weather = find_weather_of_lidars(scan.cloud);
  if (!weather.empty()) take_out(weather, scan);
}

/// @param flags  of the points that were not taken out. @param out  as given to `take_out`.
/// @return flags of all points, false for those that were taken out.
std::vector<bool> spread(const std::vector<std::uint8_t>& flags, const std::vector<bool>& out) {
  std::vector<bool> all(out.size());
  auto flag = flags.begin();
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (!out[i]) all[i] = *flag++ != 0;
  }
  return all;
}

/// Deletes flagged points where nothing can be, but for those that belong to an object.
/// @param flags  N flags, or empty = none.
std::uint64_t delete_flagged(const std::vector<std::uint8_t>& flags, ProjectionResult& projection) {
  std::uint64_t count = 0;
  for (std::size_t i = 0; i < flags.size(); ++i) {
    PointFate& fate = projection.fates[i];
    if (flags[i] == 0 || (fate != PointFate::kKept && fate != PointFate::kGround) ||
        projection.object_of_point[i] != 0)
      continue;
    --(fate == PointFate::kGround ? projection.ground : projection.kept);
    ++projection.deleted;
    fate = PointFate::kDeleted;
    ++count;
  }
  return count;
}

/// Ordinals of the scans of each drive that has some: the first, and one behind the last.
std::vector<std::pair<std::size_t, std::size_t>> ranges_of_drives(const DriveSet& drives) {
  std::vector<std::pair<std::size_t, std::size_t>> ranges;
  for (std::size_t begin = 0; begin < drives.size(); begin = ranges.back().second) {
    std::size_t end = begin;
    while (end < drives.size() && drives.place(end).drive == drives.place(begin).drive) ++end;
    ranges.emplace_back(begin, end);
  }
  return ranges;
}

/// Scans that the ground stage adapts to. Each drive's own alone: what is found in a drive then
/// depends on no other one.
std::vector<std::size_t> ground_samples(const DriveSet& drives) {
  std::vector<std::size_t> scans;
  for (const auto& [begin, end] : ranges_of_drives(drives)) {
    const std::size_t count = std::min(kLearnedScans, end - begin);
    for (std::size_t i = 0; i < count; ++i) scans.push_back(begin + i * (end - begin) / count);
  }
  return scans;
}

/// Scans that are compared to find what travels with the sensor, and an earlier one of each.
std::vector<std::pair<std::size_t, std::size_t>> vehicle_samples(const DriveSet& drives) {
  std::vector<std::pair<std::size_t, std::size_t>> all;
  for (const auto& [begin, end] : ranges_of_drives(drives)) {
    std::vector<Eigen::Isometry3d> T_map_scan;
    for (std::size_t i = begin; i < end; ++i) T_map_scan.push_back(drives.T_map_scan(i));
    for (const auto& [scan, before] : OwnVehicle::choose_samples(T_map_scan))
      all.emplace_back(begin + scan, begin + before);
  }
  return all;
}

/// What becomes of the points of one scan, in the order of its file and in the map.
class Placing {
 public:
  Placing(PlacedScan& out, const std::vector<ScanObject>& objects,
          const Eigen::Isometry3d& T_map_lidar)
      : out_(out), objects_(objects), T_map_lidar_(T_map_lidar) {}

  void run(const maps::PointCloud& cloud, const ProjectionResult& projection) {
    out_.in_object.resize(cloud.size());
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const PointFate fate = projection.fates[i];
      const bool moved = fate == PointFate::kProjected || fate == PointFate::kDeleted;
      const std::uint32_t box = projection.object_of_point[i];
      const std::uint32_t object = moved && box != 0 ? objects_[box - 1].object + 1 : 0;
      const std::size_t at = cloud.file_index(i);
      out_.fates.fates[at] = fate;
      out_.fates.objects[at] = object;
      out_.in_object[i] = moved;
      if (object != 0) ++out_.points_removed[object];
      if (fate == PointFate::kDeleted) continue;
      const bool inside = out_.voxels.add({T_map_lidar_ * projection.positions[i].cast<double>(),
                                           cloud.intensities.empty() ? 0.0F : cloud.intensities[i],
                                           kind_of(fate), object});
      if (inside) continue;
      ++out_.counts["dropped_beyond_grid"];
      out_.fates.fates[at] = PointFate::kDropped;
      out_.fates.objects[at] = 0;
    }
  }

 private:
  PlacedScan& out_;
  const std::vector<ScanObject>& objects_;
  const Eigen::Isometry3d& T_map_lidar_;
};

}  // namespace

ScanWork::ScanWork(const DriveSet& drives, const MapBuildOptions& options, const VoxelGrid& grid)
    : drives_(drives),
      options_(options),
      grid_(grid),
      boxes_are_given_(!boxes_files(options.detector).empty()) {
  for (std::size_t i = 0; i < drives.drives().size(); ++i) {
    const maps::Drive& drive = drives.drives()[i];
    const std::string detector = detector_of_drive(options.detector, i, drives.drives().size());
    if (boxes_are_given_) drive.require_own_numbers(detector);
    detectors_.push_back(make_detector(detector, drive.size()));
    grounds_.push_back(make_ground_segmenter(options.ground));
  }
}

std::map<std::string, std::size_t> ScanWork::dropped_boxes() const {
  std::map<std::string, std::size_t> dropped;
  for (const auto& detector : detectors_) add_to(dropped, detector->dropped());
  return dropped;
}

std::vector<std::size_t> ScanWork::scans_to_learn_from(const DriveSet& drives) {
  std::vector<std::size_t> scans = ground_samples(drives);
  for (const auto& [scan, before] : vehicle_samples(drives))
    scans.insert(scans.end(), {scan, before});
  return scans;
}

void ScanWork::learn(ScanRange range, const CancelFlag& cancel) {
  const auto read_dry = [this](std::size_t number) {
    Counts unused;
    maps::Scan scan = drives_.read(number, unused);
    take_out_weather(scan);
    return scan;
  };
  const auto is_of_others = [&](std::size_t scan) {
    const auto drive_of = [this](std::size_t ordinal) { return drives_.place(ordinal).drive; };
    return range.size() == 0 || drive_of(scan) < drive_of(range.begin) ||
           drive_of(scan) > drive_of(range.end - 1);
  };
  std::vector<std::size_t> of_ground = ground_samples(drives_);
  std::erase_if(of_ground, is_of_others);
  std::size_t learned = 0;
  process_in_order(
      of_ground.size(), options_.threads, [&](std::size_t i) { return read_dry(of_ground[i]); },
      [&](const maps::Scan& scan) {
        const std::size_t drive = drives_.place(of_ground[learned++]).drive;
        if (!scan.cloud.empty()) grounds_[drive]->learn(scan.cloud);
      },
      cancel);
  auto of_vehicle = vehicle_samples(drives_);
  std::erase_if(of_vehicle, [&](const auto& scans) {
    return is_of_others(scans.first) || drives_.note(scans.first) == ScanNote::kHidden ||
           drives_.note(scans.second) == ScanNote::kHidden;
  });
  std::vector<std::vector<OwnVehicle::Sample>> samples(drives_.drives().size());
  std::size_t taken = 0;
  process_in_order(
      of_vehicle.size(), options_.threads,
      [&](std::size_t i) {
        const auto [number, before] = of_vehicle[i];
        const maps::Scan scan = read_dry(number), earlier = read_dry(before);
        const GroundSegmenter& ground = ground_of(number);
        const std::vector<std::uint8_t> is_ground = ground.segment(scan.cloud).is_ground;
        std::vector<Eigen::Vector3f> standing;
        for (std::size_t k = 0; k < is_ground.size(); ++k) {
          if (is_ground[k] == 0) standing.push_back(scan.cloud.positions[k]);
        }
        return OwnVehicle::Sample{
            std::move(standing), RangeView(earlier.cloud, ground.segment(earlier.cloud).is_ground),
            drives_.T_map_scan(before).inverse() * drives_.T_map_scan(number)};
      },
      [&](OwnVehicle::Sample sample) {
        const std::size_t drive = drives_.place(of_vehicle[taken++].first).drive;
        samples[drive].push_back(std::move(sample));
      },
      cancel);
  for (const auto& each : samples) vehicles_.emplace_back(each);
}

const GroundSegmenter& ScanWork::ground_of(std::size_t scan) const {
  return *grounds_[drives_.place(scan).drive];
}

maps::Scan ScanWork::read(std::size_t scan, Counts& counts, StageSeconds& seconds) const {
  const StageTimer timer(seconds, "read");
  return drives_.read(scan, counts);
}

SurveyedScan ScanWork::survey(std::size_t number) const {
  SurveyedScan out;
  out.scan = number;
  maps::Scan scan = read(number, out.counts, out.stage_seconds);
  {
    const StageTimer timer(out.stage_seconds, "checksum");
    out.sha256 = drives_.sha256(number);
  }
  out.counts["in"] = scan.points_in_file;
  out.counts["dropped_non_finite"] = scan.dropped.non_finite;
  out.counts["dropped_zero_range"] = scan.dropped.zero_range;
  if (scan.dropped.unsure > 0) out.counts["dropped_unsure"] = scan.dropped.unsure;
  const bool is_hidden = drives_.note(number) == ScanNote::kHidden;
  out.counts["scans_empty"] = scan.cloud.empty() && !is_hidden ? 1 : 0;
  // Only where there are any: maps of earlier versions keep their digests.
  if (is_hidden) out.counts["scans_hidden"] = 1;
  // Ground, detectors and views see what they would see in clear weather and without a trailer.
  std::vector<bool> unseen(scan.cloud.size());
  {
    const StageTimer timer(out.stage_seconds, "weather");
    out.weather = find_weather_of_lidars(scan.cloud);
    if (!out.weather.empty()) unseen = out.weather;
    const OwnVehicle* vehicle = vehicle_of(number);
    for (std::size_t i = 0; vehicle != nullptr && i < unseen.size(); ++i)
      unseen[i] = unseen[i] || vehicle->holds(scan.cloud.positions[i]);
    take_out(unseen, scan);
  }
  GroundResult ground;
  {
    const StageTimer timer(out.stage_seconds, "ground");
    ground = ground_of(number).segment(scan.cloud);
    out.is_ground = spread(ground.is_ground, unseen);
  }
  if (!scan.cloud.empty() && options_.detects()) {
    const StageTimer timer(out.stage_seconds, "detect");
    out.boxes = detectors_[drives_.place(number).drive]->detect(scan, ground);
    // Given boxes are of the lidar's frame, found ones of the frame that the scan was looked at in.
    if (boxes_are_given_) {
      const Eigen::Isometry3d T_scan_lidar(drives_.R_scan_lidar(number));
      for (maps::Box& box : out.boxes) box = to_map(box, T_scan_lidar);
    }
  }
  {
    const StageTimer timer(out.stage_seconds, "fuse ground");
    out.ground_cells =
        reduce_ground(scan.cloud, ground.is_ground, out.boxes, T_local_lidar(number));
  }
  // Only what goes by shapes in single scans is judged by them, see `fuse_objects`.
  if (ground.surface && options_.detector == kGeometricDetector) {
    const StageTimer timer(out.stage_seconds, "obstacles");
    out.obstacles = reduce_obstacles(scan.cloud.positions, ground.is_ground, *ground.surface,
                                     T_local_lidar(number));
  }
  const StageTimer timer(out.stage_seconds, "view");
  out.view.emplace(scan.cloud, ground.is_ground);
  return out;
}

Eigen::Isometry3d ScanWork::T_local_lidar(std::size_t scan) const {
  Eigen::Isometry3d T = drives_.T_map_scan(scan);
  T.translation() -= grid_.origin();
  return T;
}

const OwnVehicle* ScanWork::vehicle_of(std::size_t scan) const {
  if (vehicles_.empty()) return nullptr;
  const OwnVehicle& vehicle = vehicles_[drives_.place(scan).drive];
  return vehicle.empty() ? nullptr : &vehicle;
}

PlacedScan ScanWork::place(const ScanToPlace& asked, const FusedGround* fused,
                           const PosedViews& views) const {
  const std::size_t number = asked.number;
  const std::vector<bool>& is_ground = asked.found.is_ground;
  PlacedScan out(grid_, static_cast<std::uint32_t>(number));
  Counts counted_before;
  const maps::Scan scan = read(number, counted_before, out.stage_seconds);
  out.fates.resize(scan.points_in_file);
  GroundResult local;
  if (fused == nullptr) {
    const StageTimer timer(out.stage_seconds, "ground");
    local = ground_of(number).segment(scan.cloud);
  }
  ProjectionResult projection;
  {
    const StageTimer timer(out.stage_seconds, "project");
    std::vector<MovableBox> boxes;
    for (const ScanObject& each : asked.objects) boxes.push_back(each.movable);
    const std::vector<std::uint8_t> flags(is_ground.begin(), is_ground.end());
    projection = fused != nullptr
                     ? project_objects(scan.cloud, flags, BelowFused(*fused, T_local_lidar(number)),
                                       boxes, options_.projection)
                     : project_objects(scan.cloud, flags, BelowLocal(*local.surface), boxes,
                                       options_.projection);
  }
  out.counts["buried"] = out.counts["weather"] = out.counts["own_vehicle"] = 0;
  if (options_.clean == "free-space") {
    const StageTimer timer(out.stage_seconds, "clean");
    const std::vector<Eigen::Vector3f>& positions = scan.cloud.positions;
    if (fused != nullptr)
      out.counts["buried"] = delete_flagged(
          find_buried_points(positions, is_ground, T_local_lidar(number), *fused), projection);
    out.counts["weather"] = delete_flagged(
        find_unconfirmed_points(positions, asked.found.weather, number, views), projection);
    if (const OwnVehicle* vehicle = vehicle_of(number)) {
      std::vector<std::uint8_t> flags(positions.size());
      for (std::size_t i = 0; i < flags.size(); ++i)
        flags[i] = vehicle->holds(positions[i]) ? 1 : 0;
      out.counts["own_vehicle"] = delete_flagged(flags, projection);
    }
  }
  out.counts["kept_by_edits"] = put_back(scan.cloud, is_ground, asked.kept, projection);
  out.counts["ground"] = projection.ground;
  out.counts["projected"] = projection.projected;
  out.counts["deleted"] = projection.deleted;
  out.counts["without_ground"] = projection.without_ground;
  const StageTimer timer(out.stage_seconds, "reduce");
  Placing(out, asked.objects, drives_.T_map_scan(number)).run(scan.cloud, projection);
  return out;
}

}  // namespace stillmap::mapping
