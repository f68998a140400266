#include "answers_json.hpp"

#include "json_values.hpp"
#include "registration_json.hpp"

#include <stillmap/maps/box.hpp>
#include <stillmap/maps/frames.hpp>

#include <cmath>

namespace stillmap::server {
namespace {

std::uint64_t point_count(const maps::MapManifest& manifest) {
  std::uint64_t points = 0;
  // Coarser levels hold the same points again, thinned.
  for (const maps::TileEntry& tile : manifest.tiles) points += tile.id.level == 0 ? tile.points : 0;
  return points;
}

Json reference(const std::string& map, const std::string& version, const std::string& digest) {
  return {{"name", map}, {"version", version}, {"digest", digest}};
}

Json optional_text(const std::optional<std::string>& text) { return text ? Json(*text) : Json(); }

/// What the store knows of a map, whatever its versions hold.
Json stored(const maps::StoredMap& map) {
  return {{"name", map.name},
          {"version", optional_text(map.active)},
          {"previous_version", optional_text(map.previous)},
          {"revision", map.revision},
          {"created_ns", std::to_string(map.created_ns)}};
}

std::string_view name_of(MapState state) {
  switch (state) {
    case MapState::kOpened:
      return "opened";
    case MapState::kLoading:
      return "loading";
    case MapState::kReady:
      return "ready";
    case MapState::kFailed:
      break;
  }
  return "failed";
}

Json refusal(const ServedVersion& version) {
  return {{"name", version.map}, {"version", version.version}, {"reason", version.failure}};
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
  json["covariance"] = has_pose ? to_json_array(result.covariance) : Json();
  json["covariance_order"] = {"tx", "ty", "tz", "rx", "ry", "rz"};
  json["protection"] = protection(answer);
  json["inlier_ratio"] = result.inlier_ratio;
  json["rmse_m"] = result.rmse_m;
  json["movable_points"] = answer.movable_points;
  json["degenerate_directions"] = directions(result.degenerate_directions);
  json["prior_to_pose"] = has_pose && answer.parameters.prior
                              ? offset(answer.parameters.prior->T_map_lidar, result.T_map_lidar)
                              : Json();
}

}  // namespace

std::string pose_answer_json(const PoseAnswer& answer) {
  Json json;
  json["status"] = localization::name_of(answer.result.status);
  json["reasons"] = answer.result.reasons;
  add_pose(json, answer);
  json["iterations"] = answer.result.iterations;
  json["map"] = reference(answer.map_name, answer.map_version, answer.map_digest);
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

std::string map_list_json(const std::vector<ListedMap>& maps,
                          const std::vector<ServedVersion>& waiting) {
  Json json;
  json["maps"] = Json::array();
  json["refused"] = Json::array();
  for (const ListedMap& map : maps) {
    Json entry = stored(map.stored);
    entry["state"] = map.served ? name_of(map.served->state) : "empty";
    if (map.served && map.served->package) {
      const maps::MapPackage& package = *map.served->package;
      entry["version"] = map.served->version;
      entry["digest"] = package.digest();
      entry["points"] = point_count(package.manifest());
      entry["tiles"] = package.manifest().tiles.size();
    }
    json["maps"].push_back(std::move(entry));
    if (map.served && map.served->state == MapState::kFailed)
      json["refused"].push_back(refusal(*map.served));
  }
  for (const ServedVersion& version : waiting)
    if (version.state == MapState::kFailed) json["refused"].push_back(refusal(version));
  return to_text(json);
}

std::string stored_map_json(const maps::StoredMap& map) { return to_text(stored(map)); }

namespace {

Json described(const maps::StoredVersion& version) {
  return {{"version", version.name},
          {"digest", version.digest},
          {"bytes", version.bytes},
          {"created_ns", std::to_string(version.created_ns)}};
}

}  // namespace

std::string version_json(const maps::StoredVersion& version) { return to_text(described(version)); }

std::string version_list_json(const maps::StoredMap& map,
                              const std::vector<maps::StoredVersion>& versions) {
  Json json = stored(map);
  json["versions"] = Json::array();
  for (const maps::StoredVersion& version : versions) {
    Json entry = described(version);
    entry["active"] = version.name == map.active;
    json["versions"].push_back(std::move(entry));
  }
  return to_text(json);
}

std::string map_json(const maps::StoredMap& map, const ServedVersion& version) {
  const maps::MapPackage& package = *version.package;
  const maps::MapManifest& manifest = package.manifest();
  Json json = stored(map);
  json["version"] = version.version;
  json["digest"] = package.digest();
  json["state"] = name_of(version.state);
  json["schema"] = manifest.schema;
  json["frame_id"] = manifest.frame_id;
  json["origin"] = to_json_array(manifest.origin);
  if (const auto& origin = manifest.geodetic_origin) {
    json["geodetic_origin"] = {{"latitude_deg", origin->latitude_deg},
                               {"longitude_deg", origin->longitude_deg},
                               {"altitude_m", origin->altitude_m}};
  }
  if (manifest.registration) json["registration"] = to_json(*manifest.registration);
  json["voxel_size_m"] = manifest.voxel_size_m;
  json["relative_clock"] = manifest.relative_clock;
  json["counts"] = manifest.counts;
  json["tile_size_m"] = maps::kTileSizeM;
  json["tiles"] = Json::array();
  for (const maps::TileEntry& tile : manifest.tiles) {
    json["tiles"].push_back({{"level", tile.id.level},
                             {"x", tile.id.x},
                             {"y", tile.id.y},
                             {"points", tile.points},
                             {"min", tile.min},
                             {"max", tile.max}});
  }
  json["objects"] = package.objects().size();
  std::size_t poses = 0;
  for (const maps::Trajectory& drive : package.trajectories()) poses += drive.size();
  json["poses"] = poses;
  return to_text(json);
}

std::string trajectories_json(const std::vector<maps::Trajectory>& drives) {
  Json json;
  json["poses"] = Json::array();
  for (std::size_t drive = 0; drive < drives.size(); ++drive) {
    for (const maps::StampedPose& each : drives[drive].poses()) {
      Json pose;
      pose["drive"] = drive;
      pose["stamp_ns"] = std::to_string(each.stamp_ns);
      pose.update(to_json_pose(each.T_map_lidar));
      json["poses"].push_back(std::move(pose));
    }
  }
  return to_text(json);
}

std::string objects_json(const std::vector<maps::MapObject>& objects) {
  Json json;
  json["objects"] = Json::array();
  for (std::size_t i = 0; i < objects.size(); ++i) {
    const maps::MapObject& object = objects[i];
    for (const maps::MapObject::Placement& place : object.placements) {
      json["objects"].push_back({{"object", i},
                                 {"scan", place.scan},
                                 {"centre", to_json_array(place.centre_map)},
                                 {"size", to_json_array(object.size_m)},
                                 {"yaw", place.yaw_rad},
                                 {"class", maps::name_of(object.object_class)},
                                 {"motion", maps::name_of(object.motion)},
                                 {"score", object.score},
                                 {"first_scan", object.first_scan},
                                 {"last_scan", object.last_scan},
                                 {"points_removed", object.points_removed}});
    }
  }
  return to_text(json);
}

std::string problem_json(const ApiError& error, const std::string& request_id) {
  const ErrorInfo& info = info_of(error.code());
  Json json;
  json["type"] = "urn:stillmap:error:" + std::string(info.text);
  json["title"] = info.title;
  json["status"] = info.http_status;
  json["detail"] = error.what();
  json["code"] = info.text;
  json["request_id"] = request_id;
  json["errors"] = Json::array();
  for (const FieldError& each : error.errors()) {
    json["errors"].push_back(
        {{"path", each.path}, {"found", each.found}, {"expected", each.expected}});
  }
  return to_text(json);
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
