#include "pose/session.hpp"

#include "json/json_values.hpp"

#include <stillmap/maps/map_package.hpp>

#include <algorithm>
#include <utility>

namespace stillmap::server {

namespace {

/// 12 hex digits of the hash of 128 random bits: nobody finds these from them.
std::string shown_label(const Session::Name& name) {
  return name.label.empty() ? maps::sha256_of(name.id).substr(0, 12) : name.label;
}

std::string status_event_json(const localization::TrackedPose& pose) {
  return to_text(Json{{"status", localization::name_of(pose.result.status)},
                      {"reasons", localization::names_of(pose.result.reasons)},
                      {"stamp_ns", std::to_string(pose.stamp_ns)}});
}

std::string version_event_json(const std::string& map, const std::string& version) {
  return to_text(Json{{"map", map}, {"version", version}});
}

std::string handed_over_event_json(const std::string& from, const ServedVersion& map,
                                   std::int64_t stamp_ns) {
  return to_text(Json{{"from_map", from},
                      {"map", map.map},
                      {"version", map.version},
                      {"stamp_ns", std::to_string(stamp_ns)}});
}

std::string closed_event_json(const std::string& reason) {
  return to_text(Json{{"reason", reason}});
}

}  // namespace

Session::Session(Name name, ServedVersion map, AlignmentQueue& queue)
    : name_(std::move(name)),
      shown_label_(shown_label(name_)),
      line_(queue),
      vehicle_{
          .map = map,
          .tracker = localization::Tracker(map.aligners->front().second, map.localization.tracker),
          .is_rolled_out = name_.is_rolled_out,
          .begin = {}},
      map_(std::move(map)) {
  summary_.active_version = map_.version;
}

ServedVersion Session::map() const {
  const std::scoped_lock lock(mutex_);
  return map_;
}

Session::Tracked Session::track(const SetOfRequest& set, const ScanInSet& scan) {
  const std::scoped_lock tracking(tracker_mutex_);
  SetTrackedPose pose = track_in_set(vehicle_, set, scan);
  Tracked tracked{.pose = std::move(pose), .map = vehicle_.map};
  const std::scoped_lock lock(mutex_);
  if (map_.map != tracked.map.map || map_.version != tracked.map.version) {
    map_ = tracked.map;
    name_.is_rolled_out = vehicle_.is_rolled_out;
    summary_.active_version = map_.version;
  }
  note(tracked);
  return tracked;
}

/// Under the lock.
void Session::note(const Tracked& tracked) {
  const localization::TrackedPose& pose = tracked.pose.pose;
  const std::int64_t stamp_ns = pose.stamp_ns;
  if (!tracked.pose.handed_over_from.empty())
    events_.add("handed_over",
                handed_over_event_json(tracked.pose.handed_over_from, tracked.map, stamp_ns));
  ++summary_.scans;
  const auto& reasons = pose.result.reasons;
  // What was newest then was of another clock. Sent once more, a scan has the same answer.
  const bool is_set_back = std::find(reasons.begin(), reasons.end(),
                                     localization::Reason::kClockSetBack) != reasons.end();
  if (is_set_back && stamp_ns != clock_set_back_ns_) {
    clock_set_back_ns_ = stamp_ns;
    summary_.stamp_ns.reset();
  }
  // A late scan says nothing of where the vehicle is now.
  if (summary_.stamp_ns && *summary_.stamp_ns >= stamp_ns) return;
  summary_.stamp_ns = stamp_ns;
  summary_.reasons = pose.result.reasons;
  if (pose.result.status != localization::PoseStatus::kLost) {
    summary_.place = Place{.stamp_ns = stamp_ns,
                           .T_map_lidar = pose.result.T_map_lidar,
                           .covariance = pose.result.covariance,
                           .inlier_ratio = pose.result.inlier_ratio};
  }
  if (summary_.status != pose.result.status) {
    summary_.status = pose.result.status;
    events_.add("status", status_event_json(pose));
  }
}

void Session::initialize(const PlaceInSet& place) {
  const SessionLine::Pause pause(line_);
  const std::scoped_lock lock(tracker_mutex_);
  const ServedVersion& map = vehicle_.map;
  vehicle_.begin.reset();
  const bool is_placed = place.prior || place.gnss;
  if (is_placed && name_.set.empty()) {
    vehicle_.tracker.initialize(place.prior->T_map_lidar, place.prior->covariance.value());
  } else {
    vehicle_.tracker =
        localization::Tracker(map.aligners->front().second, map.localization.tracker);
    // In which map it is, its first scan tells.
    if (is_placed) vehicle_.begin = place;
  }
  const std::scoped_lock summary_lock(mutex_);
  // Stamps may start anew, as after a clock was set back.
  clock_set_back_ns_.reset();
  summary_.stamp_ns.reset();
  summary_.status.reset();
  summary_.reasons.clear();
  summary_.place.reset();
}

void Session::note_active_version(const std::string& map, const std::string& version) {
  const std::scoped_lock lock(mutex_);
  if (map != map_.map || summary_.active_version == version) return;
  summary_.active_version = version;
  events_.add("version_activated", version_event_json(map_.map, version));
}

bool Session::lost_its_version(const std::string& map, const std::string& version,
                               const std::string& active) {
  const std::scoped_lock lock(mutex_);
  if (map != map_.map) return false;
  if (active == map_.version) name_.is_rolled_out = false;
  return name_.is_rolled_out && version != map_.version;
}

void Session::close(const std::string& reason) {
  line_.close();
  events_.add("closed", closed_event_json(reason));
  events_.close();
}

Session::Summary Session::summary(Clock::time_point now) const {
  const std::scoped_lock lock(mutex_);
  Summary summary = summary_;
  summary.idle = now - last_used_;
  return summary;
}

void Session::touch(Clock::time_point now) {
  const std::scoped_lock lock(mutex_);
  last_used_ = now;
}

Session::Clock::time_point Session::last_used() const {
  const std::scoped_lock lock(mutex_);
  return last_used_;
}

}  // namespace stillmap::server
