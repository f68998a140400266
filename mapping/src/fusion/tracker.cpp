#include "fusion/box_frames.hpp"
#include "fusion/track.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>
#include <utility>

namespace stillmap::mapping {
namespace {

/// A track with no box for so long is over; what stands still is joined later, by its place [s].
constexpr double kMaxGapS = 0.8;
/// Nor before it has missed so many scans, for drives of which only some scans are used.
constexpr std::size_t kMinMissed = 3;
/// A box further from where a track should be belongs to another, in deviations and [m]: cars
/// parked side by side are 2.5 m apart.
constexpr double kGateSigmas = 3.0;
constexpr double kGateM = 4.0;

struct OpenTrack {
  std::size_t track = 0;
  MotionState state;
  double time_s = 0.0;
  std::size_t missed = 0;
  maps::ObjectClass object_class = maps::ObjectClass::kUnknown;
};

struct Pair {
  double cost = 0.0;
  std::size_t open = 0;
  std::size_t box = 0;
  bool operator<(const Pair& other) const {
    return std::tie(cost, open, box) < std::tie(other.cost, other.open, other.box);
  }
};

/// Joins the boxes of one drive, scan by scan.
class DriveTracker {
 public:
  DriveTracker(std::vector<Track>& tracks, std::size_t drive) : tracks_(tracks), drive_(drive) {}

  void add(std::size_t ordinal, const DetectedScan& scan) {
    const double time_s = time_of(scan);
    std::vector<Hit> hits;
    for (const maps::Box& box : scan.boxes) {
      Hit hit{ordinal, to_map(box, scan.T_map_lidar), scan.T_map_lidar.translation().head<2>()};
      if (box.track >= 0) {
        add_given(std::move(hit));
      } else {
        hits.push_back(std::move(hit));
      }
    }
    predict(time_s);
    const std::vector<std::uint8_t> taken = assign(hits);
    for (std::size_t i = 0; i < hits.size(); ++i) {
      if (taken[i] == 0) start(hits[i], time_s);
    }
    std::erase_if(open_, [&](const OpenTrack& open) {
      return open.missed > kMinMissed && time_s - open.time_s > kMaxGapS;
    });
  }

 private:
  /// Seconds since the drive began; stamps that do not increase count as equal.
  double time_of(const DetectedScan& scan) {
    if (!began_ns_) began_ns_ = scan.stamp_ns;
    now_s_ = std::max(now_s_, static_cast<double>(scan.stamp_ns - *began_ns_) * 1e-9);
    return now_s_;
  }

  std::size_t new_track(bool given) {
    tracks_.push_back({drive_, given, {}});
    return tracks_.size() - 1;
  }

  void add_given(Hit hit) {
    auto [at, is_new] = given_.try_emplace(hit.box.track, tracks_.size());
    if (is_new) new_track(true);
    tracks_[at->second].hits.push_back(std::move(hit));
  }

  void predict(double time_s) {
    for (OpenTrack& open : open_) {
      open.state = predicted(open.state, time_s - predicted_s_, motion_noise_of(open.object_class));
      ++open.missed;
    }
    predicted_s_ = time_s;
  }

  std::vector<std::uint8_t> assign(const std::vector<Hit>& hits) {
    std::vector<Pair> pairs;
    for (std::size_t o = 0; o < open_.size(); ++o) {
      for (std::size_t i = 0; i < hits.size(); ++i) {
        if (!may_be_one(open_[o].object_class, hits[i].box.object_class)) continue;
        const double sigma_m = centre_sigma_m(open_[o].object_class);
        const double distance_m = (open_[o].state.position - hits[i].box.centre.head<2>()).norm();
        const double variance = open_[o].state.covariance(0, 0) + sigma_m * sigma_m;
        const double cost = distance_m * distance_m / variance;
        if (distance_m < kGateM && cost < kGateSigmas * kGateSigmas) pairs.push_back({cost, o, i});
      }
    }
    std::sort(pairs.begin(), pairs.end());
    std::vector<std::uint8_t> taken(hits.size(), 0), used(open_.size(), 0);
    for (const Pair& pair : pairs) {
      if (taken[pair.box] != 0 || used[pair.open] != 0) continue;
      taken[pair.box] = used[pair.open] = 1;
      take(open_[pair.open], hits[pair.box]);
    }
    return taken;
  }

  void take(OpenTrack& open, const Hit& hit) {
    open.state = updated(open.state, hit.box.centre.head<2>(), centre_sigma_m(open.object_class));
    open.time_s = predicted_s_;
    open.missed = 0;
    tracks_[open.track].hits.push_back(hit);
  }

  void start(const Hit& hit, double time_s) {
    const maps::ObjectClass object_class = hit.box.object_class;
    const std::size_t track = new_track(false);
    tracks_[track].hits.push_back(hit);
    open_.push_back({track,
                     started_at(hit.box.centre.head<2>(), centre_sigma_m(object_class),
                                motion_noise_of(object_class)),
                     time_s, 0, object_class});
  }

  std::vector<Track>& tracks_;
  std::size_t drive_;
  std::optional<std::int64_t> began_ns_;
  double now_s_ = 0.0;
  double predicted_s_ = 0.0;
  std::vector<OpenTrack> open_;
  std::map<int, std::size_t> given_;
};

}  // namespace

bool is_small(maps::ObjectClass object_class) {
  return object_class == maps::ObjectClass::kPedestrian ||
         object_class == maps::ObjectClass::kCyclist ||
         object_class == maps::ObjectClass::kMotorcycle;
}

bool may_be_one(maps::ObjectClass a, maps::ObjectClass b) {
  return a == maps::ObjectClass::kUnknown || b == maps::ObjectClass::kUnknown ||
         is_small(a) == is_small(b);
}

MotionNoise motion_noise_of(maps::ObjectClass object_class) {
  if (object_class == maps::ObjectClass::kPedestrian) return {1.0, 1.5};
  // Braking with 3 m/s^2 for half a second; people on wheels are slower but turn faster.
  return {4.0, is_small(object_class) ? 4.0 : 8.0};
}

double centre_sigma_m(maps::ObjectClass object_class) {
  return is_small(object_class) ? 0.25 : 0.5;
}

std::vector<Track> tracks_of(const std::vector<DetectedScan>& scans) {
  std::vector<Track> tracks;
  std::map<std::size_t, DriveTracker> drives;
  for (std::size_t i = 0; i < scans.size(); ++i) {
    const std::size_t drive = scans[i].drive;
    drives.try_emplace(drive, tracks, drive).first->second.add(i, scans[i]);
  }
  return tracks;
}

}  // namespace stillmap::mapping
