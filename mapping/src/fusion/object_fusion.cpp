#include "fusion/object_fusion.hpp"

#include "fusion/box_frames.hpp"
#include "fusion/moving.hpp"
#include "fusion/sight.hpp"
#include "fusion/standing.hpp"
#include "fusion/track.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

/// Below it more speaks against an object than for it.
constexpr double kMinExistence = 0.5;

void check(const std::vector<DetectedScan>& scans) {
  for (std::size_t i = 0; i < scans.size(); ++i) {
    if (!scans[i].T_map_lidar.matrix().allFinite())
      throw std::invalid_argument(fmt::format("scan {}: a pose that is not finite", i));
    for (std::size_t b = 0; b < scans[i].boxes.size(); ++b) {
      const maps::Box& box = scans[i].boxes[b];
      const bool usable = box.centre.allFinite() && box.size_m.allFinite() &&
                          (box.size_m.array() > 0.0).all() && std::isfinite(box.yaw_rad) &&
                          box.score >= 0.0 && box.score <= 1.0;
      if (!usable) {
        throw std::invalid_argument(fmt::format(
            "scan {} box {}: centre {} {} {}, size {} {} {}, yaw {}, score {}; expected "
            "finite numbers, sizes > 0, a score in [0, 1]",
            i, b, box.centre.x(), box.centre.y(), box.centre.z(), box.size_m.x(), box.size_m.y(),
            box.size_m.z(), box.yaw_rad, box.score));
      }
    }
  }
}

double best_score(const Track& track) {
  double score = 0.0;
  for (const Hit& hit : track.hits) score = std::max(score, hit.box.score);
  return score;
}

FusedObject fused_standing(const Track& track, const SightLines& sight) {
  const StandingObject standing = standing_object(track, sight);
  FusedObject object;
  object.object_class = standing.box.object_class;
  object.size_m = standing.box.size_m;
  object.existence = track.given ? best_score(track) : existence_of(standing.evidence);
  for (const auto& [scan, detected] : standing.scans)
    object.placements.push_back({scan, standing.box, detected});
  return object;
}

FusedObject fused_moving(const Track& track, const std::vector<DetectedScan>& scans,
                         const std::vector<std::size_t>& drive_scans, const SightLines& sight) {
  MovingObject moving = moving_object(track, scans, drive_scans, sight);
  FusedObject object;
  object.object_class = moving.box.object_class;
  object.size_m = moving.box.size_m;
  object.existence = track.given ? best_score(track) : existence_of(moving.evidence);
  object.moving = true;
  object.placements = std::move(moving.placements);
  return object;
}

}  // namespace

FusedObjects fuse_boxes(const std::vector<DetectedScan>& scans, const BoxRayCounter& count_rays) {
  check(scans);
  const SightLines sight(scans, count_rays);
  std::vector<std::vector<std::size_t>> drive_scans(sight.drives());
  for (std::size_t i = 0; i < scans.size(); ++i) drive_scans[scans[i].drive].push_back(i);
  std::vector<std::vector<Track>> standing(sight.drives());
  FusedObjects fused;
  const auto keep = [&](FusedObject object, bool given) {
    if (object.placements.empty()) return;
    const bool certain = given || object.existence >= kMinExistence;
    (certain ? fused.objects : fused.doubtful).push_back(std::move(object));
  };
  for (Track& track : tracks_of(scans)) {
    if (has_moved(track, sight)) {
      keep(fused_moving(track, scans, drive_scans[track.drive], sight), track.given);
    } else if (track.given) {
      keep(fused_standing(track, sight), true);
    } else {
      standing[track.drive].push_back(std::move(track));
    }
  }
  for (std::vector<Track>& tracks : standing) {
    for (const Track& track : joined_by_place(std::move(tracks)))
      keep(fused_standing(track, sight), false);
  }
  for (std::vector<FusedObject>* objects : {&fused.objects, &fused.doubtful}) {
    std::stable_sort(objects->begin(), objects->end(),
                     [](const FusedObject& a, const FusedObject& b) {
                       return a.placements.front().scan < b.placements.front().scan;
                     });
    number_objects(*objects);
  }
  return fused;
}

std::vector<FusedObject> fuse_objects(const std::vector<DetectedScan>& scans,
                                      const BoxRayCounter& count_rays) {
  return fuse_boxes(scans, count_rays).objects;
}

void number_objects(std::vector<FusedObject>& objects) {
  for (std::size_t i = 0; i < objects.size(); ++i) {
    for (ObjectPlacement& placement : objects[i].placements) {
      placement.box.track = static_cast<int>(i);
      placement.box.object_class = objects[i].object_class;
      placement.box.score = objects[i].existence;
    }
  }
}

}  // namespace stillmap::mapping
