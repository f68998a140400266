#include "inspection_json.hpp"

#include "json/json_values.hpp"
#include "registration_json.hpp"

namespace stillmap::server {
namespace {

Json bounds(const Eigen::AlignedBox3d& box) {
  if (box.isEmpty()) return {};
  return {{"min", to_json_array(box.min())}, {"max", to_json_array(box.max())}};
}

Json geodetic(const std::optional<maps::GeodeticOrigin>& origin) {
  if (!origin) return {};
  return {{"latitude_deg", origin->latitude_deg},
          {"longitude_deg", origin->longitude_deg},
          {"altitude_m", origin->altitude_m}};
}

Json findings_json(const std::vector<maps::DriveFinding>& findings) {
  Json json = Json::array();
  for (const maps::DriveFinding& finding : findings)
    json.push_back({{"code", finding.code}, {"what", finding.what}, {"remedy", finding.remedy}});
  return json;
}

void add_check(const maps::DriveCheck& check, Json& json) {
  if (check.periods)
    json["periods"] = {{"median_s", check.periods->median_s},
                       {"longest_s", check.periods->longest_s},
                       {"longest_after_scan", check.periods->longest_after},
                       {"gaps", check.periods->gaps}};
  if (check.intensities) json["intensities"] = *check.intensities;
  if (check.overlap)
    json["pose_overlap"] = {{"given", check.overlap->given},
                            {"without", check.overlap->without},
                            {"other", check.overlap->other},
                            {"other_reading", check.overlap->other_reading},
                            {"pairs", check.overlap->pairs}};
  if (check.mounting) {
    const Eigen::Quaterniond q(check.mounting->R_level_lidar);
    json["mounting"] = {{"quaternion_level_lidar", {q.x(), q.y(), q.z(), q.w()}},
                        {"height_m", check.mounting->height_m},
                        {"tilt_rad", check.mounting->tilt_rad},
                        {"scans", check.mounting->scans}};
  }
  json["findings"] = findings_json(check.findings);
}

Json choices_json(const std::vector<maps::RecordingTopic>& topics) {
  Json json = Json::array();
  for (const maps::RecordingTopic& topic : topics)
    json.push_back({{"choice", topic.word + "=" + topic.name},
                    {"word", topic.word},
                    {"topic", topic.name},
                    {"type", topic.type},
                    {"messages", topic.messages},
                    {"frame_id", topic.frame_id}});
  return json;
}

std::string listed_json(const DriveSummary& summary, Json choices) {
  Json json;
  json["scans"] = summary.scans;
  json["duration_s"] = summary.duration_s;
  json["topic"] = summary.topic;
  json["findings"] = findings_json(summary.check.findings);
  json["notes"] = summary.notes;
  json["choices"] = std::move(choices);
  return to_text(json);
}

}  // namespace

std::string inspection_json(const CloudFileSummary& summary) {
  Json json;
  json["kind"] = "cloud";
  json["format"] = summary.format;
  json["bytes"] = summary.bytes;
  json["points"] = summary.cloud.points_in_file;
  json["non_finite"] = summary.cloud.non_finite;
  json["withheld"] = summary.cloud.withheld;
  json["fields"] = summary.cloud.fields;
  json["single_precision"] = summary.cloud.single_precision;
  json["coordinates"] = summary.cloud.coordinates;
  json["utm_epsg"] = summary.cloud.utm ? Json(summary.cloud.utm->epsg()) : Json();
  json["bounds"] = bounds(summary.bounds);
  json["viewpoint"] = summary.cloud.viewpoint ? to_json_pose(*summary.cloud.viewpoint) : Json();
  json["intensities"] = summary.intensities;
  json["findings"] = findings_json(summary.findings);
  return to_text(json, 2);
}

std::string inspection_json(const TrajectorySummary& summary) {
  Json json;
  json["kind"] = "trajectory";
  json["format"] = summary.format;
  json["poses"] = summary.poses;
  json["duration_s"] = summary.duration_s;
  json["path_length_m"] = summary.path_length_m;
  json["bounds"] = bounds(summary.bounds);
  return to_text(json, 2);
}

std::string inspection_json(const MapSummary& summary) {
  const maps::MapManifest& manifest = summary.manifest;
  Json json;
  json["kind"] = "map";
  json["digest"] = summary.digest;
  json["version"] = summary.digest.substr(0, 12);
  if (summary.content_digest) json["content_digest"] = *summary.content_digest;
  json["schema"] = manifest.schema;
  json["software_version"] = manifest.software_version;
  json["frame_id"] = manifest.frame_id;
  json["origin"] = to_json_array(manifest.origin);
  json["geodetic_origin"] = geodetic(manifest.geodetic_origin);
  if (manifest.registration) json["registration"] = to_json(*manifest.registration);
  json["voxel_size_m"] = manifest.voxel_size_m;
  json["relative_clock"] = manifest.relative_clock;
  json["points"] = summary.points;
  json["tiles"] = manifest.extent.tiles;
  json["bounds_map"] = bounds(summary.bounds_map);
  json["objects"] = summary.objects;
  json["poses"] = summary.poses;
  json["path_length_m"] = summary.path_length_m;
  if (const auto& bent = summary.bent)
    json["bent"] = {
        {"poses", bent->poses}, {"worst_pose", bent->worst}, {"worst_m", bent->worst_m}};
  json["counts"] = manifest.counts;
  json["options"] = manifest.options;
  json["sources"] = manifest.sources;
  return to_text(json, 2);
}

std::string inspection_json(const DriveSummary& summary) {
  Json json;
  json["kind"] = "drive";
  json["layout"] = maps::name_of(summary.layout);
  json["scans"] = summary.scans;
  json["duration_s"] = summary.duration_s;
  json["rate_hz"] = summary.rate_hz;
  json["relative_clock"] = summary.relative_clock;
  json["has_poses"] = summary.has_poses;
  json["has_point_times"] = summary.has_point_times;
  json["has_labels"] = summary.has_labels;
  if (!summary.topic.empty()) {
    json["topic"] = summary.topic;
    json["frame_id"] = summary.frame_id;
    json["fields"] = summary.fields;
  }
  json["path_length_m"] = summary.path_length_m;
  json["geodetic_origin"] = geodetic(summary.origin);
  json["first_scan"] = {{"points", summary.first_scan_points},
                        {"non_finite", summary.first_scan_dropped.non_finite},
                        {"zero_range", summary.first_scan_dropped.zero_range},
                        {"unsure", summary.first_scan_dropped.unsure},
                        {"bounds_lidar", bounds(summary.first_scan_bounds)}};
  json["sensors"] = summary.sensors;
  if (const auto& imu = summary.imu)
    json["imu"] = {{"source", imu->source},   {"readings", imu->readings},
                   {"rate_hz", imu->rate_hz}, {"longest_gap_s", imu->longest_gap_s},
                   {"first_s", imu->first_s}, {"last_s", imu->last_s}};
  json["notes"] = summary.notes;
  add_check(summary.check, json);
  return to_text(json, 2);
}

std::string inspection_json(const maps::ChoiceError& error) {
  Json json;
  json["kind"] = "recording";
  json["needs_choice"] = error.what();
  json["choices"] = choices_json(error.topics());
  return to_text(json, 2);
}

std::string listed_inspection_json(const DriveSummary& summary) {
  return listed_json(summary, Json::array());
}

std::string listed_inspection_json(const maps::ChoiceError& error) {
  return listed_json({}, choices_json(error.topics()));
}

}  // namespace stillmap::server
