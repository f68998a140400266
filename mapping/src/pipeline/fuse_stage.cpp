#include "pipeline/fuse_stage.hpp"
#include "fusion/standing_verdict.hpp"
#include "pipeline/build.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace stillmap::mapping {
namespace {

double yaw_in(const Eigen::Isometry3d& T_a_b, double yaw_b_rad) {
  const Eigen::Vector3d heading =
      T_a_b.linear() * Eigen::Vector3d(std::cos(yaw_b_rad), std::sin(yaw_b_rad), 0.0);
  return std::atan2(heading.y(), heading.x());
}

maps::Box moved_by(const Eigen::Isometry3d& T_a_b, maps::Box box) {
  box.centre = T_a_b * box.centre;
  box.yaw_rad = yaw_in(T_a_b, box.yaw_rad);
  return box;
}

std::vector<DetectedScan> detected_scans(const DriveSet& drives, const Survey& survey) {
  std::vector<DetectedScan> scans;
  scans.reserve(drives.size());
  for (std::size_t i = 0; i < drives.size(); ++i)
    scans.push_back(
        {drives.place(i).drive, drives.stamp_ns(i), drives.T_map_scan(i), survey.boxes[i]});
  return scans;
}

/// Every box an object of its own: nothing is known of its motion.
std::vector<FusedObject> unfused(const std::vector<DetectedScan>& scans) {
  std::vector<FusedObject> objects;
  for (std::size_t i = 0; i < scans.size(); ++i) {
    for (const maps::Box& box : scans[i].boxes) {
      FusedObject object;
      object.object_class = box.object_class;
      object.size_m = box.size_m;
      object.existence = box.score;
      object.placements = {{i, moved_by(scans[i].T_map_lidar, box), true}};
      objects.push_back(std::move(object));
    }
  }
  return objects;
}

/// Speed of an object at one of its placements from those around it.
double speed_mps(const DriveSet& drives, const FusedObject& object, std::size_t at) {
  if (!object.moving) return 0.0;
  const std::size_t before = at == 0 ? 0 : at - 1;
  const std::size_t after = std::min(at + 1, object.placements.size() - 1);
  const ObjectPlacement& a = object.placements[before];
  const ObjectPlacement& b = object.placements[after];
  const double seconds =
      1e-9 * static_cast<double>(drives.stamp_ns(b.scan) - drives.stamp_ns(a.scan));
  return seconds > 0.0 ? (b.box.centre - a.box.centre).norm() / seconds : 0.0;
}

std::vector<EditScan> edit_scans_of(const DriveSet& drives) {
  std::vector<EditScan> scans;
  for (std::size_t i = 0; i < drives.size(); ++i) {
    const DriveSet::Place at = drives.place(i);
    const std::filesystem::path& root = drives.drives()[at.drive].contents().root;
    scans.push_back({std::filesystem::weakly_canonical(root).filename().string(), at.index,
                     drives.T_map_scan(i).translation(), at.drive});
  }
  return scans;
}

std::vector<std::vector<ScanObject>> scan_objects(const DriveSet& drives,
                                                  const std::vector<FusedObject>& objects) {
  std::vector<std::vector<ScanObject>> by_scan(drives.size());
  for (std::size_t i = 0; i < objects.size(); ++i) {
    for (std::size_t k = 0; k < objects[i].placements.size(); ++k) {
      const ObjectPlacement& place = objects[i].placements[k];
      const Eigen::Isometry3d T_lidar_map = drives.T_map_scan(place.scan).inverse();
      by_scan[place.scan].push_back(
          {{moved_by(T_lidar_map, place.box), speed_mps(drives, objects[i], k)},
           static_cast<std::uint32_t>(i)});
    }
  }
  return by_scan;
}

BuildObjects objects_of(const Build& build) {
  const Survey& survey = *build.survey;
  const BuildTask& task = build.task;
  const std::vector<DetectedScan> scans = detected_scans(*build.drives, survey);
  FusedObjects fused;
  if (task.options.fusion) {
    const BoxRayCounter count_rays = [&](std::size_t scan, const maps::Box& box) {
      // Fusion asks this many thousand times.
      if (task.cancel) throw Cancelled();
      return survey.view(scan)->count(box);
    };
    fused = fuse_boxes(scans, count_rays);
    // The verdict is one on what goes by shapes in single scans. A network has learned these, and
    // its scores are probabilities already; what a user gives is not doubted.
    if (task.options.detector == kGeometricDetector)
      judge_standing(fused, survey.obstacles, scans, count_rays, build.grid->origin());
  } else {
    fused.objects = unfused(scans);
  }
  EditResult edits = apply_edits(fused, task.edits, edit_scans_of(*build.drives));
  return in_scans(build, std::move(fused.objects), std::move(edits));
}

}  // namespace

BuildObjects in_scans(const Build& build, std::vector<FusedObject> objects, EditResult edits) {
  const DriveSet& drives = *build.drives;
  const std::vector<EditScan> edit_scans = edit_scans_of(drives);
  BuildObjects out;
  out.edits = std::move(edits);
  out.objects = std::move(objects);
  out.by_scan = scan_objects(drives, out.objects);
  out.kept_by_scan.resize(drives.size());
  for (std::size_t i = 0; i < drives.size(); ++i) {
    const Eigen::Isometry3d T_lidar_map = drives.T_map_scan(i).inverse();
    for (const maps::Box& box : kept_regions(build.task.edits, edit_scans[i]))
      out.kept_by_scan[i].push_back(moved_by(T_lidar_map, box));
  }
  return out;
}

void fuse_objects(Build& build) {
  const StageTimer timer(build.result.stage_seconds, "fuse");
  build.tell("fuse", 0, 1);
  build.objects = objects_of(build);
  build.stop_if_cancelled();
  build.survey->ground.finish(footprints_of(build.objects.objects, build.grid->origin()));
  build.tell("fuse", 1, 1);
}

std::vector<GroundFootprint> footprints_of(const std::vector<FusedObject>& objects,
                                           const Eigen::Vector3d& origin) {
  std::vector<GroundFootprint> footprints;
  for (const FusedObject& object : objects) {
    // What moved left its ground to be seen.
    if (object.moving) continue;
    const maps::Box& box = object.placements.front().box;
    footprints.push_back({box.centre - origin,
                          0.5 * object.size_m.head<2>(),
                          {std::cos(box.yaw_rad), std::sin(box.yaw_rad)}});
  }
  return footprints;
}

std::vector<maps::MapObject> to_map_objects(
    const DriveSet& drives, const std::vector<FusedObject>& objects,
    const std::map<std::uint32_t, std::uint64_t>& points_removed, bool fused) {
  std::vector<maps::MapObject> out;
  out.reserve(objects.size());
  for (const FusedObject& object : objects) {
    maps::MapObject& each = out.emplace_back();
    const std::size_t first = object.placements.front().scan;
    const std::size_t last = object.placements.back().scan;
    each.object_class = object.object_class;
    each.size_m = object.size_m;
    each.score = object.existence;
    each.motion = !fused          ? maps::ObjectMotion::kUnknown
                  : object.moving ? maps::ObjectMotion::kMoving
                                  : maps::ObjectMotion::kParked;
    each.drive = drives.place(first).drive;
    each.first_scan = first;
    each.last_scan = last;
    each.first_stamp_ns = drives.stamp_ns(first);
    each.last_stamp_ns = drives.stamp_ns(last);
    each.detections = static_cast<std::size_t>(
        std::count_if(object.placements.begin(), object.placements.end(),
                      [](const ObjectPlacement& place) { return place.detected; }));
    for (const ObjectPlacement& place : object.placements) {
      each.placements.push_back({place.scan, place.box.centre, place.box.yaw_rad});
      if (!object.moving) break;
    }
    const auto removed = points_removed.find(static_cast<std::uint32_t>(out.size()));
    each.points_removed = removed == points_removed.end() ? 0 : removed->second;
  }
  return out;
}

}  // namespace stillmap::mapping
