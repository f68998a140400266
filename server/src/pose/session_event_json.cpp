#include "pose/session_event_json.hpp"

#include "json/json_values.hpp"

namespace stillmap::server {

std::string status_event_json(const localization::TrackedPose& pose) {
  return to_text(Json{{"status", localization::name_of(pose.result.status)},
                      {"reasons", localization::names_of(pose.result.reasons)},
                      {"stamp_ns", std::to_string(pose.stamp_ns)}});
}

std::string version_event_json(const std::string& map, const std::string& version) {
  return to_text(Json{{"map", map}, {"version", version}});
}

std::string closed_event_json(const std::string& reason) {
  return to_text(Json{{"reason", reason}});
}

}  // namespace stillmap::server
