#include "fusion/standing.hpp"

#include "fusion/box_estimate.hpp"
#include "fusion/box_frames.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

namespace stillmap::mapping {
namespace {

/// Farther away a scan has few points on an object [m].
constexpr double kReachM = 80.0;
/// Misses beyond this range are not counted: detectors see as far as they like [m].
constexpr double kMissReachM = 30.0;
/// Other drives are asked from as near as this, and so many of their scans [m].
constexpr double kOtherDayReachM = 25.0;
constexpr std::size_t kOtherDayScans = 12;
/// Scans in a row that must see a place free before it is so: single ones see through gaps.
constexpr int kFreeInARow = 2;

constexpr std::size_t kMaxWindows = 16;

/// A parked car's box jumps by up to 2 m between the corners that are seen.
constexpr double kMovedSigmas = 4.5;
constexpr std::size_t kMinHitsUnseen = 4;

constexpr double kJoinOfJoint = 0.2;
constexpr double kJoinOfSmaller = 0.5;

/// Most of what a detector without a network brings once is nothing.
constexpr double kPriorLogOdds = -1.0;
/// What was not there at another time is no part of the street.
constexpr double kFreeElsewhenLogOdds = 2.0;
/// Two scans are two opinions when the sensor went so far between them [m]; nearer ones repeat each
/// other.
constexpr double kNewViewM = 5.0;
constexpr double kSameView = 0.02;
/// Boxes that share less of their joint area with the whole say nothing for it, those that share
/// more say all they can.
constexpr double kNoAgreement = 0.35;
constexpr double kFullAgreement = 0.7;
}  // namespace

double log_odds_of(double score) {
  const double p = std::clamp(score, 0.1, 0.95);
  return std::log(p / (1.0 - p));
}

namespace {

/// Hits that follow each other, with the median of their centres.
struct Window {
  std::vector<Hit> hits;
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
};

std::vector<Window> windows_of(const Track& track) {
  const Eigen::Vector3d size_m = size_of(track.hits);
  const std::size_t n = track.hits.size();
  const std::size_t width =
      std::max<std::size_t>({1, std::min<std::size_t>(5, n / 3), n / kMaxWindows});
  std::vector<Window> windows;
  for (std::size_t begin = 0; begin + width <= n; begin += width) {
    Window window;
    std::vector<std::pair<double, double>> x, y;
    for (std::size_t i = begin; i < begin + width; ++i) {
      window.hits.push_back(track.hits[i]);
      const Eigen::Vector2d centre = aligned_centre(track.hits[i], size_m);
      x.emplace_back(centre.x(), 1.0);
      y.emplace_back(centre.y(), 1.0);
    }
    window.centre = {weighted_quantile(x, 0.5), weighted_quantile(y, 0.5)};
    windows.push_back(std::move(window));
  }
  return windows;
}

/// How often the place of some hits was free, less how often it was not, in the scans of others.
int times_free(const Window& place, const Window& times, const SightLines& sight) {
  const maps::Box box = standing_box(place.hits);
  int sum = 0;
  for (const Hit& hit : times.hits) {
    const Sight seen = sight.look(hit.scan, box).sight;
    if (seen == Sight::kFree) ++sum;
    if (seen == Sight::kOccupied) --sum;
  }
  return sum;
}

}  // namespace

bool has_moved(const Track& track, const SightLines& sight) {
  const std::vector<Window> windows = windows_of(track);
  double farthest_m = 0.0;
  std::pair<std::size_t, std::size_t> ends;
  for (std::size_t i = 0; i < windows.size(); ++i) {
    for (std::size_t j = i + 1; j < windows.size(); ++j) {
      const double distance_m = (windows[i].centre - windows[j].centre).norm();
      if (distance_m > farthest_m) ends = {i, j};
      farthest_m = std::max(farthest_m, distance_m);
    }
  }
  const maps::ObjectClass object_class = class_of(track.hits);
  const double sigma_m = centre_sigma_m(object_class);
  if (!(farthest_m > kMovedSigmas * sigma_m)) return false;
  if (track.given) return true;
  const Window& early = windows[ends.first];
  const Window& late = windows[ends.second];
  const int free = times_free(early, late, sight) + times_free(late, early, sight);
  if (free != 0) return free > 0;
  return track.hits.size() >= kMinHitsUnseen && farthest_m > size_of(track.hits).x();
}

namespace {

/// Tracks overlap as one object does with itself, found from two sides.
bool at_one_place(const maps::Box& a, const maps::Box& b) {
  if (!may_be_one(a.object_class, b.object_class)) return false;
  if (!(std::abs(a.centre.z() - b.centre.z()) < 0.5 * (a.size_m.z() + b.size_m.z()))) return false;
  const BoxOverlap overlap = overlap_of(a, b);
  return overlap.of_joint > kJoinOfJoint || overlap.of_smaller > kJoinOfSmaller;
}

/// Groups of tracks by place; a track meets only the groups of the cells around it.
class Places {
 public:
  /// Adds a track to the group it overlaps most, or to a new one.
  void add(std::size_t track, const maps::Box& box) {
    const auto [x, y] = cell_of(box);
    std::size_t best = groups_.size();
    double most = 0.0;
    for (std::int64_t cx = x - 1; cx <= x + 1; ++cx) {
      for (std::int64_t cy = y - 1; cy <= y + 1; ++cy) {
        const auto cell = cells_.find({cx, cy});
        if (cell == cells_.end()) continue;
        for (const std::size_t group : cell->second) {
          if (!at_one_place(groups_[group].box, box)) continue;
          const double shared_m2 = shared_area_m2(groups_[group].box, box);
          if (shared_m2 > most) best = group;
          most = std::max(most, shared_m2);
        }
      }
    }
    if (best == groups_.size()) {
      groups_.push_back({box, {}});
      cells_[{x, y}].push_back(best);
    }
    groups_[best].tracks.push_back(track);
  }

  struct Group {
    maps::Box box;
    std::vector<std::size_t> tracks;
  };
  [[nodiscard]] const std::vector<Group>& groups() const { return groups_; }

 private:
  /// Centres of boxes of 12 m that overlap are never two cells apart.
  static constexpr double kCellM = 12.0;
  static std::pair<std::int64_t, std::int64_t> cell_of(const maps::Box& box) {
    return {static_cast<std::int64_t>(std::floor(box.centre.x() / kCellM)),
            static_cast<std::int64_t>(std::floor(box.centre.y() / kCellM))};
  }
  std::vector<Group> groups_;
  std::map<std::pair<std::int64_t, std::int64_t>, std::vector<std::size_t>> cells_;
};

bool earlier(const Hit& a, const Hit& b) { return a.scan < b.scan; }

}  // namespace

std::vector<Track> joined_by_place(std::vector<Track> tracks) {
  std::vector<std::size_t> order(tracks.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  // The best seen first: their boxes are what the others are held against.
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return tracks[a].hits.size() > tracks[b].hits.size();
  });
  Places places;
  for (const std::size_t track : order) places.add(track, standing_box(tracks[track].hits));
  std::vector<Track> joined;
  for (const Places::Group& group : places.groups()) {
    std::vector<std::size_t> members = group.tracks;
    std::sort(members.begin(), members.end());
    Track track{tracks[members.front()].drive, false, {}};
    for (const std::size_t member : members) {
      std::vector<Hit>& hits = tracks[member].hits;
      track.hits.insert(track.hits.end(), hits.begin(), hits.end());
    }
    std::stable_sort(track.hits.begin(), track.hits.end(), earlier);
    joined.push_back(std::move(track));
  }
  std::stable_sort(joined.begin(), joined.end(), [](const Track& a, const Track& b) {
    return earlier(a.hits.front(), b.hits.front());
  });
  return joined;
}

namespace {

/// A scan near a place, with what it says.
struct View {
  std::size_t scan = 0;
  bool hit = false;
  Look look;
  bool gone = false;
};

std::vector<View> views_of(const Track& track, const maps::Box& box, const SightLines& sight) {
  std::map<std::size_t, double> scores;
  for (const Hit& hit : track.hits) {
    double& score = scores[hit.scan];
    score = std::max(score, hit.box.score);
  }
  std::vector<View> views;
  for (const std::size_t scan : sight.scans_near(track.drive, box.centre.head<2>(), kReachM)) {
    const bool hit = scores.erase(scan) != 0;
    views.push_back({scan, hit, sight.look(scan, box), false});
  }
  // Detectors may see farther than that.
  for (const auto& [scan, score] : scores)
    views.push_back({scan, true, sight.look(scan, box), false});
  std::sort(views.begin(), views.end(),
            [](const View& a, const View& b) { return a.scan < b.scan; });
  return views;
}

/// Marks the views of times when the object was not there: runs that saw the place free, and
/// everything before the last such run ahead of the first hit and after the first one behind the
/// last hit.
void mark_gone(std::vector<View>& views) {
  std::size_t first = views.size(), last = 0;
  for (std::size_t i = 0; i < views.size(); ++i) {
    if (!views[i].hit) continue;
    first = std::min(first, i);
    last = i;
  }
  std::size_t run_begin = 0, run_last = 0;
  int in_a_row = 0;
  const auto close_run = [&] {
    if (in_a_row >= kFreeInARow) {
      const std::size_t from = run_last < first ? 0 : run_begin;
      const std::size_t to = run_begin > last ? views.size() - 1 : run_last;
      for (std::size_t i = from; i <= to; ++i) views[i].gone = true;
    }
    in_a_row = 0;
  };
  for (std::size_t i = 0; i < views.size(); ++i) {
    if (views[i].look.sight == Sight::kFree && !views[i].hit) {
      if (in_a_row++ == 0) run_begin = i;
      run_last = i;
    } else if (views[i].hit || views[i].look.sight == Sight::kOccupied) {
      close_run();
    }
  }
  close_run();
}

/// What the boxes of each scan say, by their scores and by how far they agree with the whole.
std::map<std::size_t, double> opinions_of(const Track& track, const maps::Box& box) {
  std::map<std::size_t, double> opinions;
  for (const Hit& hit : track.hits) {
    const double agreement = std::clamp(
        (overlap_of(hit.box, box).of_joint - kNoAgreement) / (kFullAgreement - kNoAgreement), 0.0,
        1.0);
    const double log_odds = agreement * log_odds_of(hit.box.score);
    const auto [at, is_new] = opinions.try_emplace(hit.scan, log_odds);
    if (!is_new) at->second = std::max(at->second, log_odds);
  }
  return opinions;
}

/// Whether another drive saw the place free and never taken: an evenly spread dozen of its near
/// scans are asked.
bool free_on_another_day(const Track& track, const maps::Box& box, const SightLines& sight) {
  for (std::size_t drive = 0; drive < sight.drives(); ++drive) {
    if (drive == track.drive) continue;
    const std::vector<std::size_t> near =
        sight.scans_near(drive, box.centre.head<2>(), kOtherDayReachM);
    const std::size_t asked = std::min(near.size(), kOtherDayScans);
    int free = 0, occupied = 0;
    for (std::size_t i = 0; i < asked; ++i) {
      const Sight seen = sight.look(near[i * near.size() / asked], box).sight;
      free += seen == Sight::kFree ? 1 : 0;
      occupied += seen == Sight::kOccupied ? 1 : 0;
    }
    if (free >= kFreeInARow && occupied == 0) return true;
  }
  return false;
}

Evidence evidence_of(const Track& track, const std::vector<View>& views, const maps::Box& box,
                     const SightLines& sight) {
  Evidence evidence;
  const std::map<std::size_t, double> opinions = opinions_of(track, box);
  const std::size_t first = track.hits.front().scan, last = track.hits.back().scan;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const View& view = views[i];
    const double weight =
        i == 0 ? kSameView : view_weight(sight.travel_m(views[i - 1].scan, view.scan));
    const bool between = view.scan > first && view.scan < last;
    if (view.hit) {
      ++evidence.hits;
      evidence.log_odds += weight * opinions.at(view.scan);
    } else if (view.look.sight == Sight::kFree) {
      if (between) evidence.log_odds += kFreeLogOdds;
    } else if (!view.gone && view.look.points >= kMinPointsToMiss &&
               sight.distance_m(view.scan, box.centre.head<2>()) < kMissReachM) {
      ++evidence.missed;
      evidence.log_odds += weight * kMissLogOdds;
    }
    evidence.free_elsewhen = evidence.free_elsewhen || (view.gone && !between);
  }
  evidence.free_elsewhen = evidence.free_elsewhen || free_on_another_day(track, box, sight);
  return evidence;
}

}  // namespace

double view_weight(double travel_m) { return std::clamp(travel_m / kNewViewM, kSameView, 1.0); }

double existence_of(const Evidence& evidence) {
  const double log_odds =
      kPriorLogOdds + evidence.log_odds + (evidence.free_elsewhen ? kFreeElsewhenLogOdds : 0.0);
  return 1.0 / (1.0 + std::exp(-log_odds));
}

StandingObject standing_object(const Track& track, const SightLines& sight) {
  StandingObject object;
  object.box = standing_box(track.hits);
  std::vector<View> views = views_of(track, object.box, sight);
  mark_gone(views);
  object.evidence = evidence_of(track, views, object.box, sight);
  for (const View& view : views) {
    if (view.gone) continue;
    if (view.hit || view.look.points > 0 || sight.has_points(view.scan, object.box))
      object.scans.emplace_back(view.scan, view.hit);
  }
  return object;
}

}  // namespace stillmap::mapping
