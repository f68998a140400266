#include "bodies/session_json.hpp"

#include "json/json_values.hpp"

namespace stillmap::server {
namespace {

/// Keys of the place where the vehicle was last.
void add_place(Json& json, const std::optional<Session::Place>& place) {
  json["pose"] = place ? to_json_pose(place->T_map_lidar) : Json();
  json["pose_stamp_ns"] = place ? Json(std::to_string(place->stamp_ns)) : Json();
  json["covariance"] = place ? to_json_array(place->covariance) : Json();
  json["covariance_order"] = {"tx", "ty", "tz", "rx", "ry", "rz"};
  json["inlier_ratio"] = place ? Json(place->inlier_ratio) : Json();
}

/// All but its secret.
Json to_json(const Session& session, std::chrono::seconds idle_limit) {
  const Session::Summary summary = session.summary(Session::Clock::now());
  Json json;
  json["label"] = session.label();
  const ServedVersion map = session.map();
  json["map"] = {{"name", map.map}, {"version", map.version}, {"digest", map.package->digest()}};
  if (!session.set().empty()) json["set"] = session.set();
  json["active_version"] = summary.active_version;
  json["scans"] = summary.scans;
  json["status"] = summary.status ? Json(localization::name_of(*summary.status)) : Json();
  json["reasons"] = localization::names_of(summary.reasons);
  json["stamp_ns"] = summary.stamp_ns ? Json(std::to_string(*summary.stamp_ns)) : Json();
  add_place(json, summary.place);
  json["idle_s"] = summary.idle.count();
  json["idle_limit_s"] = idle_limit.count();
  return json;
}

}  // namespace

std::string session_json(const Session& session, std::chrono::seconds idle_limit) {
  Json json{{"id", session.id()}};
  json.update(to_json(session, idle_limit));
  return to_text(json);
}

std::string session_list_json(const SessionList& list, std::chrono::seconds idle_limit) {
  Json json;
  json["sessions"] = Json::array();
  for (const auto& each : list.sessions) {
    Json session = to_json(*each, idle_limit);
    const std::string& owner = each->owner();
    if (owner == list.caller) session["id"] = each->id();
    session["key_id"] = owner.empty() ? Json() : Json(owner);
    const auto name = list.key_names.find(owner);
    session["key_name"] = name == list.key_names.end() ? Json() : Json(name->second);
    json["sessions"].push_back(std::move(session));
  }
  return to_text(json);
}

}  // namespace stillmap::server
