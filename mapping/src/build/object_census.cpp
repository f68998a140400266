#include "build/object_census.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <limits>

namespace stillmap::mapping {
namespace {

constexpr double kGateM = 2.5;
constexpr std::size_t kMaxMissedScans = 5;
constexpr double kParkedM = 1.0;
constexpr std::size_t kMinHits = 3;

struct Track {
  int number = -1;
  Eigen::Vector3d first = Eigen::Vector3d::Zero();
  Eigen::Vector3d last = Eigen::Vector3d::Zero();
  /// Position in the list of scans with objects.
  std::size_t seen = 0;
  std::size_t hits = 0;
  double farthest_m = 0.0;
};

Track* track_of(std::vector<Track>& tracks, const maps::MapObject& object, std::size_t now) {
  Track* best = nullptr;
  double nearest_m = kGateM;
  for (Track& track : tracks) {
    if (object.track >= 0 || track.number >= 0) {
      if (object.track >= 0 && track.number == object.track) return &track;
      continue;
    }
    // A track takes one box a scan.
    if (track.seen == now || now - track.seen > kMaxMissedScans) continue;
    const double distance_m = (track.last - object.centre_map).norm();
    if (distance_m < nearest_m) {
      nearest_m = distance_m;
      best = &track;
    }
  }
  return best;
}

}  // namespace

ObjectCensus census_of(const std::vector<maps::MapObject>& objects) {
  std::vector<Track> tracks;
  std::size_t now = 0;
  std::size_t scan = std::numeric_limits<std::size_t>::max();
  for (const maps::MapObject& object : objects) {
    if (object.scan != scan) ++now;
    scan = object.scan;
    Track* track = track_of(tracks, object, now);
    if (track == nullptr) {
      tracks.push_back({.number = object.track, .first = object.centre_map});
      track = &tracks.back();
    }
    track->last = object.centre_map;
    track->seen = now;
    ++track->hits;
    track->farthest_m = std::max(track->farthest_m, (object.centre_map - track->first).norm());
  }
  ObjectCensus census;
  for (const Track& track : tracks) {
    if (track.hits < kMinHits) {
      ++census.brief;
    } else if (track.farthest_m > kParkedM) {
      ++census.moving;
    } else {
      ++census.parked;
    }
  }
  return census;
}

}  // namespace stillmap::mapping
