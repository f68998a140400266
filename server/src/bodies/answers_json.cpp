#include "bodies/answers_json.hpp"

#include "json/json_values.hpp"

#include <stillmap/maps/frames.hpp>

#include <cmath>

namespace stillmap::server {
namespace {

Json reference(const std::string& map, const std::string& version, const std::string& digest) {
  return {{"name", map}, {"version", version}, {"digest", digest}};
}

Json directions(const std::vector<Eigen::Matrix<double, 6, 1>>& each) {
  Json array = Json::array();
  for (const Eigen::Matrix<double, 6, 1>& direction : each)
    array.push_back(to_json_array(direction));
  return array;
}

Json offset(const Eigen::Isometry3d& T_map_prior, const Eigen::Isometry3d& T_map_lidar) {
  const Eigen::Isometry3d T_prior_lidar = T_map_prior.inverse() * T_map_lidar;
  return {{"m", T_prior_lidar.translation().norm()},
          {"rad", maps::rotation_angle_rad(T_prior_lidar.linear())}};
}

Json bound(double value) { return std::isfinite(value) ? Json(value) : Json(); }

/// In the base frame when the mount is known; null where there is no bound.
Json protection(const PoseAnswer& answer) {
  const auto& T_base_lidar = answer.parameters.T_base_lidar;
  const localization::ProtectionLevels levels =
      T_base_lidar ? localization::protection_levels_in_base(answer.result, *T_base_lidar)
                   : answer.result.protection;
  return {{"longitudinal_m", bound(levels.longitudinal_m)},
          {"lateral_m", bound(levels.lateral_m)},
          {"vertical_m", bound(levels.vertical_m)},
          {"yaw_rad", bound(levels.yaw_rad)}};
}

/// The keys that a pose carries; null when there is none, so that nobody drives on by mistake.
void add_pose(Json& json, const PoseAnswer& answer) {
  const localization::AlignmentResult& result = answer.result;
  const bool has_pose = result.status != localization::PoseStatus::kLost;
  json["pose"] = has_pose ? to_json_pose(result.T_map_lidar) : Json();
  if (const auto& T_base_lidar = answer.parameters.T_base_lidar) {
    json["T_map_base"] =
        has_pose ? to_json_pose(result.T_map_lidar * T_base_lidar->inverse()) : Json();
  }
  if (!answer.set.empty() && answer.T_set_map)
    json["T_set_lidar"] = has_pose ? to_json_pose(*answer.T_set_map * result.T_map_lidar) : Json();
  json["covariance"] = has_pose ? to_json_array(result.covariance) : Json();
  json["covariance_order"] = {"tx", "ty", "tz", "rx", "ry", "rz"};
  json["protection"] = protection(answer);
  json["inlier_ratio"] = result.inlier_ratio;
  json["rmse_m"] = result.rmse_m;
  json["movable_points"] = answer.movable_points;
  json["no_returns"] = answer.no_returns;
  json["degenerate_directions"] = directions(result.degenerate_directions);
  json["prior_to_pose"] = has_pose && answer.parameters.prior
                              ? offset(answer.parameters.prior->T_map_lidar, result.T_map_lidar)
                              : Json();
}

}  // namespace

std::string pose_answer_json(const PoseAnswer& answer) {
  Json json;
  json["status"] = localization::name_of(answer.result.status);
  json["reasons"] = localization::names_of(answer.result.reasons);
  add_pose(json, answer);
  json["iterations"] = answer.result.iterations;
  json["map"] = reference(answer.map_name, answer.map_version, answer.map_digest);
  if (!answer.set.empty()) json["set"] = answer.set;
  const auto& stamp_ns = answer.parameters.stamp_ns;
  // As text: beyond 2^53 a JSON number is no longer exact.
  json["stamp_ns"] = stamp_ns ? Json(std::to_string(*stamp_ns)) : Json();
  json["timing_ms"] = {{"wait", answer.timing.wait_ms},
                       {"decode", answer.timing.decode_ms},
                       {"align", answer.timing.align_ms},
                       {"total", answer.timing.total_ms}};
  json["warnings"] = Json::array();
  if (const auto& skew_s = answer.clock_skew_s) {
    json["warnings"].push_back({{"code", "clock_skew"}, {"ahead_s", *skew_s}});
  }
  if (answer.is_replay) json["warnings"].push_back({{"code", "seal_replayed"}});
  if (!answer.other_version.empty())
    json["warnings"].push_back({{"code", "version_activated"}, {"version", answer.other_version}});
  if (!answer.handed_over_from.empty())
    json["warnings"].push_back({{"code", "handed_over"}, {"from_map", answer.handed_over_from}});
  if (!answer.session.empty()) {
    json["session"] = answer.session;
    json["searched_from"] = localization::name_of(answer.searched_from);
  }
  json["request_id"] = answer.request_id;
  return to_text(json);
}

std::string batch_answer_json(const std::vector<BatchedAnswer>& answers,
                              const std::string& request_id) {
  // The answers are JSON already; to parse them again only to write them would double the work.
  std::string text = "{\"answers\":[";
  for (const BatchedAnswer& each : answers) {
    if (text.back() == '}') text += ',';
    text += "{\"status\":" + std::to_string(each.http_status) +
            (each.http_status == 200 ? ",\"answer\":" : ",\"problem\":") + each.body + '}';
  }
  return text + "],\"request_id\":" + to_text(Json(request_id)) + '}';
}

std::string status_json(const std::string& status, const std::vector<std::string>& reasons) {
  return to_text(Json{{"status", status}, {"reasons", reasons}});
}

std::string server_status_json(const ServerStatus& status, const ServerOptions& options) {
  Json json;
  json["version"] = status.version;
  json["maps"] = status.maps;
  json["uptime_s"] = status.uptime_s;
  json["limits"] = {{"max_payload_bytes", options.max_payload_bytes},
                    {"max_json_bytes", options.max_json_bytes},
                    {"min_scan_points", options.min_scan_points},
                    {"max_scan_points", options.max_scan_points},
                    {"workers", status.workers},
                    {"queue", options.queue},
                    {"default_deadline_ms", options.default_deadline_ms},
                    {"max_batch", options.batch.max_scans},
                    {"max_sessions", options.sessions.max},
                    {"session_idle_s", options.sessions.idle_expiry_s}};
  return to_text(json);
}

}  // namespace stillmap::server
