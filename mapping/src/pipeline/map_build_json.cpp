#include <nlohmann/json.hpp>
#include <stillmap/mapping/given_pose_check.hpp>
#include <stillmap/mapping/map_build.hpp>

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

}  // namespace stillmap::mapping
