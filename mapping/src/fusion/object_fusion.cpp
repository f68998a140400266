#include "fusion/object_fusion.hpp"

#include "fusion/motion_test.hpp"
#include "fusion/moving.hpp"
#include "fusion/place_look.hpp"
#include "fusion/places.hpp"
#include "fusion/standing.hpp"
#include "fusion/track.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <span>
#include <stdexcept>
#include <utility>

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

/// Asks what all cases want to know at once, so that each scan is met once.
/// @param conclude  called with each case and its answers, in order.
template <typename Case, typename Conclude>
void ask(const PlaceLooks& looks, const std::vector<Case>& cases, const Conclude& conclude) {
  std::vector<PlaceQuestion> questions;
  std::vector<std::size_t> ends;
  for (const Case& one : cases) {
    const std::vector<PlaceQuestion> of_one = one.questions();
    questions.insert(questions.end(), of_one.begin(), of_one.end());
    ends.push_back(questions.size());
  }
  const std::vector<PlaceLook> answers = looks.answers(questions);
  std::size_t begin = 0;
  for (std::size_t i = 0; i < cases.size(); ++i) {
    conclude(cases[i], std::span(answers).subspan(begin, ends[i] - begin));
    begin = ends[i];
  }
}

/// One fusion from tracks to objects.
class Fusion {
 public:
  Fusion(const std::vector<DetectedScan>& scans, const BoxRayCounter& count_rays)
      : scans_(scans), looks_(scans, count_rays), drive_scans_(looks_.drives()) {
    for (std::size_t i = 0; i < scans.size(); ++i) drive_scans_[scans[i].drive].push_back(i);
  }

  FusedObjects run() {
    part(tracks_of(scans_));
    for (FusedObject& object : moving_objects()) keep(std::move(object));
    for (FusedObject& object : standing_objects()) keep(std::move(object));
    for (std::vector<FusedObject>* objects : {&fused_.objects, &fused_.doubtful})
      order_objects(*objects);
    return std::move(fused_);
  }

 private:
  /// Parts tracks into those that moved and those that stood, and joins the latter by place.
  void part(std::vector<Track> tracks) {
    std::vector<MotionTest> tests(tracks.begin(), tracks.end());
    std::vector<bool> moved;
    ask(looks_, tests, [&](const MotionTest& test, std::span<const PlaceLook> answers) {
      moved.push_back(test.moved(answers));
    });
    std::vector<std::vector<Track>> to_join(looks_.drives());
    for (std::size_t i = 0; i < tracks.size(); ++i) {
      if (moved[i]) {
        moving_.emplace_back(std::move(tracks[i]), scans_, drive_scans_[tracks[i].drive]);
      } else if (tracks[i].given) {
        standing_.emplace_back(std::move(tracks[i]), looks_);
      } else {
        to_join[tracks[i].drive].push_back(std::move(tracks[i]));
      }
    }
    for (std::vector<Track>& of_drive : to_join) {
      for (Track& track : joined_by_place(std::move(of_drive)))
        standing_.emplace_back(std::move(track), looks_);
    }
  }

  std::vector<FusedObject> moving_objects() {
    std::vector<MovingObject> found;
    ask(looks_, moving_, [&](const MovingCase& one, std::span<const PlaceLook> answers) {
      found.push_back(one.concluded(answers));
    });
    for (const bool at_begin : {true, false}) add_standing_ends(at_begin, found);
    std::vector<FusedObject> objects;
    for (std::size_t i = 0; i < found.size(); ++i) {
      FusedObject object = object_of(found[i].box, found[i].evidence, moving_[i].track());
      object.moving = true;
      object.placements = std::move(found[i].placements);
      objects.push_back(std::move(object));
    }
    return objects;
  }

  void add_standing_ends(bool at_begin, std::vector<MovingObject>& found) {
    std::vector<StandingCase> ends;
    std::vector<std::size_t> owners;
    for (std::size_t i = 0; i < moving_.size(); ++i) {
      const Track& end = at_begin ? moving_[i].came_from() : moving_[i].stopped_at();
      if (end.hits.empty()) continue;
      ends.emplace_back(end, looks_);
      owners.push_back(i);
    }
    std::size_t next = 0;
    ask(looks_, ends, [&](const StandingCase& end, std::span<const PlaceLook> answers) {
      const std::size_t owner = owners[next++];
      moving_[owner].add_standing_end(end.concluded(answers), at_begin, found[owner]);
    });
  }

  std::vector<FusedObject> standing_objects() {
    std::vector<FusedObject> objects;
    ask(looks_, standing_, [&](const StandingCase& one, std::span<const PlaceLook> answers) {
      const StandingObject standing = one.concluded(answers);
      FusedObject object = object_of(standing.box, standing.evidence, one.track());
      for (const auto& [scan, detected] : standing.scans)
        object.placements.push_back({scan, standing.box, detected});
      objects.push_back(std::move(object));
    });
    return objects;
  }

  [[nodiscard]] static FusedObject object_of(const maps::Box& box, const Evidence& evidence,
                                             const Track& track) {
    FusedObject object;
    object.object_class = box.object_class;
    object.size_m = box.size_m;
    object.existence = existence_of(evidence);
    if (track.given) {
      object.existence = 0.0;
      for (const Hit& hit : track.hits)
        object.existence = std::max(object.existence, hit.box.score);
    }
    return object;
  }

  void keep(FusedObject object) {
    if (object.placements.empty()) return;
    const bool certain = object.existence >= kMinExistence;
    (certain ? fused_.objects : fused_.doubtful).push_back(std::move(object));
  }

  const std::vector<DetectedScan>& scans_;
  PlaceLooks looks_;
  /// Ordinals of each drive's scans.
  std::vector<std::vector<std::size_t>> drive_scans_;
  std::vector<MovingCase> moving_;
  std::vector<StandingCase> standing_;
  FusedObjects fused_;
};

}  // namespace

FusedObjects fuse_boxes(const std::vector<DetectedScan>& scans, const BoxRayCounter& count_rays) {
  check(scans);
  return Fusion(scans, count_rays).run();
}

void order_objects(std::vector<FusedObject>& objects) {
  std::stable_sort(objects.begin(), objects.end(), [](const FusedObject& a, const FusedObject& b) {
    return a.placements.front().scan < b.placements.front().scan;
  });
  for (std::size_t i = 0; i < objects.size(); ++i) {
    for (ObjectPlacement& placement : objects[i].placements) {
      placement.box.track = static_cast<int>(i);
      placement.box.object_class = objects[i].object_class;
      placement.box.score = objects[i].existence;
    }
  }
}

}  // namespace stillmap::mapping
