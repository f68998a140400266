#include "json/session_json.hpp"

#include "json/json_values.hpp"

namespace stillmap::server {
namespace {

Json to_json(const Session& session, std::chrono::seconds idle_limit) {
  const Session::Summary summary = session.summary(Session::Clock::now());
  Json json;
  json["id"] = session.id();
  json["map"] = {{"name", session.map().map},
                 {"version", session.map().version},
                 {"digest", session.map().package->digest()}};
  json["active_version"] = summary.active_version;
  json["scans"] = summary.scans;
  json["status"] = summary.status ? Json(localization::name_of(*summary.status)) : Json();
  json["stamp_ns"] = summary.stamp_ns ? Json(std::to_string(*summary.stamp_ns)) : Json();
  json["idle_s"] = summary.idle.count();
  json["idle_limit_s"] = idle_limit.count();
  return json;
}

}  // namespace

std::string session_json(const Session& session, std::chrono::seconds idle_limit) {
  return to_text(to_json(session, idle_limit));
}

std::string session_list_json(const std::vector<std::shared_ptr<Session>>& sessions,
                              std::chrono::seconds idle_limit) {
  Json json;
  json["sessions"] = Json::array();
  for (const auto& each : sessions) json["sessions"].push_back(to_json(*each, idle_limit));
  return to_text(json);
}

std::string status_event_json(const localization::TrackedPose& pose) {
  return to_text(Json{{"status", localization::name_of(pose.result.status)},
                      {"reasons", pose.result.reasons},
                      {"stamp_ns", std::to_string(pose.stamp_ns)}});
}

std::string version_event_json(const std::string& map, const std::string& version) {
  return to_text(Json{{"map", map}, {"version", version}});
}

std::string closed_event_json(const std::string& reason) {
  return to_text(Json{{"reason", reason}});
}

}  // namespace stillmap::server
