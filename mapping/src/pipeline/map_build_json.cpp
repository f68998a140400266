#include "pipeline/map_build_json.hpp"

#include <array>
#include <limits>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <stillmap/mapping/given_pose_check.hpp>

namespace stillmap::mapping {
namespace {

nlohmann::json to_json(const Eigen::Isometry3d& T) {
  const Eigen::Vector3d p = T.translation();
  const Eigen::Quaterniond q(T.linear());
  return {{"position", {p.x(), p.y(), p.z()}}, {"quaternion", {q.x(), q.y(), q.z(), q.w()}}};
}

nlohmann::json to_json(const PoseDifferences& found) {
  return {{"median_m", found.median_m},     {"p95_m", found.p95_m},     {"max_m", found.max_m},
          {"median_rad", found.median_rad}, {"p95_rad", found.p95_rad}, {"max_rad", found.max_rad}};
}

nlohmann::json of_motions(const PoseDifferences& found) {
  nlohmann::json json = to_json(found);
  json["way_m"] = found.way_m;
  json["pairs"] = found.pairs;
  return json;
}

nlohmann::json to_json(const GivenPosesResult& result) {
  nlohmann::json apart = nlohmann::json::array();
  for (const PoseDifferences& each : result.errors.by_way)
    if (each.pairs > 0) apart.push_back(of_motions(each));
  return {{"use", name_of(result.use)},
          {"apart_from_scans", apart},
          {"apart_at_loops",
           result.errors.loops.pairs > 0 ? of_motions(result.errors.loops) : nlohmann::json()},
          {"neighbours_apart", result.neighbours_apart},
          {"sigma_m", result.errors.sigma_m},
          {"sigma_rad", result.errors.sigma_rad},
          {"asked", result.errors.asked},
          {"denied", result.errors.denied},
          {"moved", to_json(result.moved)}};
}

Eigen::Isometry3d transform_from(const nlohmann::json& json) {
  const auto p = json.at("position").get<std::array<double, 3>>();
  const auto q = json.at("quaternion").get<std::array<double, 4>>();
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = Eigen::Vector3d(p[0], p[1], p[2]);
  T.linear() = Eigen::Quaterniond(q[3], q[0], q[1], q[2]).toRotationMatrix();
  return T;
}

PoseDifferences differences_from(const nlohmann::json& json) {
  return {.way_m = json.value("way_m", 0.0),
          .pairs = json.value("pairs", std::size_t{0}),
          .median_m = json.at("median_m"),
          .p95_m = json.at("p95_m"),
          .max_m = json.at("max_m"),
          .median_rad = json.at("median_rad"),
          .p95_rad = json.at("p95_rad"),
          .max_rad = json.at("max_rad")};
}

GivenPosesResult given_poses_from(const nlohmann::json& json) {
  GivenPosesResult result;
  result.use = json.at("use") == name_of(GivenPosesUse::kExact) ? GivenPosesUse::kExact
                                                                : GivenPosesUse::kRefine;
  for (const nlohmann::json& each : json.at("apart_from_scans"))
    result.errors.by_way.push_back(differences_from(each));
  // Neighbours are always there; those without a pair are not written.
  if (result.errors.by_way.empty() || result.errors.by_way.front().way_m > 0.0)
    result.errors.by_way.emplace(result.errors.by_way.begin());
  if (const nlohmann::json& loops = json.at("apart_at_loops"); !loops.is_null())
    result.errors.loops = differences_from(loops);
  result.neighbours_apart = json.at("neighbours_apart");
  result.errors.sigma_m = json.at("sigma_m");
  result.errors.sigma_rad = json.at("sigma_rad");
  result.errors.asked = json.at("asked");
  result.errors.denied = json.at("denied");
  result.moved = differences_from(json.at("moved"));
  return result;
}

double number_from(const nlohmann::json& json) {
  return json.is_null() ? std::numeric_limits<double>::quiet_NaN() : json.get<double>();
}

SurfaceThickness surface_from(const nlohmann::json& json) {
  return {.cells = json.at("cells"),
          .planar_cells = json.at("planar_cells"),
          .median_m = number_from(json.at("thickness_median_m")),
          .p95_m = number_from(json.at("thickness_p95_m"))};
}

maps::Registration registration_from(const nlohmann::json& json) {
  return {.previous_digest = json.at("previous_digest"),
          .T_previous_map = transform_from(json.at("T_previous_map")),
          .T_map_poses = transform_from(json.at("T_map_poses")),
          .residual_m = json.at("residual_m"),
          .residual_rad = json.at("residual_rad"),
          .scans_used = json.at("scans_used"),
          .scans_asked = json.at("scans_asked")};
}

MapBuildResult result_from(const nlohmann::json& json) {
  MapBuildResult result;
  result.scans = json.at("scans");
  result.resumed_scans = json.at("resumed_scans");
  result.seconds = json.at("seconds");
  result.scans_per_second = json.at("scans_per_second");
  result.peak_rss_mib = json.at("peak_rss_mib");
  result.points = json.at("points");
  result.objects = json.at("objects");
  result.trajectory = json.at("trajectory");
  const nlohmann::json& consistency = json.at("consistency");
  result.consistency = {.mean_map_entropy = number_from(consistency.at("mean_map_entropy")),
                        .entropy_points = consistency.at("entropy_points"),
                        .walls = surface_from(consistency.at("walls")),
                        .ground = surface_from(consistency.at("ground"))};
  result.stage_seconds = json.at("stage_seconds");
  result.warnings = json.at("warnings");
  for (const nlohmann::json& each : json.at("pose_faults"))
    result.pose_faults.push_back({each.at("code"), each.at("what"), each.at("remedy")});
  result.digest = json.at("digest");
  result.merged_from = json.value("merged_from", "");
  result.found_pose_time_offsets_s = json.value("found_pose_time_offsets_s", std::vector<double>());
  if (json.contains("given_poses")) result.given_poses = given_poses_from(json.at("given_poses"));
  if (json.contains("registration"))
    result.registration = registration_from(json.at("registration"));
  return result;
}

}  // namespace

std::string to_json(const MapBuildResult& result) {
  nlohmann::json json{{"scans", result.scans},
                      {"resumed_scans", result.resumed_scans},
                      {"seconds", result.seconds},
                      {"scans_per_second", result.scans_per_second},
                      {"peak_rss_mib", result.peak_rss_mib},
                      {"points", result.points},
                      {"objects", result.objects},
                      {"trajectory", result.trajectory},
                      {"consistency", nlohmann::json::parse(to_json(result.consistency))},
                      {"stage_seconds", result.stage_seconds},
                      {"warnings", result.warnings},
                      {"pose_faults", nlohmann::json::parse(to_json(result.pose_faults))},
                      {"digest", result.digest},
                      {"version", STILLMAP_VERSION}};
  if (!result.merged_from.empty()) json["merged_from"] = result.merged_from;
  if (!result.found_pose_time_offsets_s.empty())
    json["found_pose_time_offsets_s"] = result.found_pose_time_offsets_s;
  if (result.given_poses) json["given_poses"] = to_json(*result.given_poses);
  if (const auto& registration = result.registration)
    json["registration"] = {{"previous_digest", registration->previous_digest},
                            {"T_previous_map", to_json(registration->T_previous_map)},
                            {"T_map_poses", to_json(registration->T_map_poses)},
                            {"residual_m", registration->residual_m},
                            {"residual_rad", registration->residual_rad},
                            {"scans_used", registration->scans_used},
                            {"scans_asked", registration->scans_asked}};
  return json.dump(2);
}

MapBuildResult build_result_from(const std::string& text) {
  try {
    return result_from(nlohmann::json::parse(text));
  } catch (const nlohmann::json::exception& error) {
    throw std::invalid_argument(std::string("a build's result: ") + error.what());
  }
}

}  // namespace stillmap::mapping
