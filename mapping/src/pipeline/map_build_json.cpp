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

nlohmann::json to_json(const GivenPosesResult& report) {
  nlohmann::json apart = nlohmann::json::array();
  for (const PoseDifferences& each : report.errors.by_way)
    if (each.pairs > 0) apart.push_back(of_motions(each));
  return {{"use", name_of(report.use)},
          {"apart_from_scans", apart},
          {"apart_at_loops",
           report.errors.loops.pairs > 0 ? of_motions(report.errors.loops) : nlohmann::json()},
          {"neighbours_apart", report.neighbours_apart},
          {"sigma_m", report.errors.sigma_m},
          {"sigma_rad", report.errors.sigma_rad},
          {"asked", report.errors.asked},
          {"denied", report.errors.denied},
          {"moved", to_json(report.moved)}};
}

}  // namespace

std::string to_json(const MapBuildResult& report) {
  nlohmann::json json{{"scans", report.scans},
                      {"resumed_scans", report.resumed_scans},
                      {"seconds", report.seconds},
                      {"scans_per_second", report.scans_per_second},
                      {"peak_rss_mib", report.peak_rss_mib},
                      {"points", report.points},
                      {"objects", report.objects},
                      {"trajectory", report.trajectory},
                      {"consistency", nlohmann::json::parse(to_json(report.consistency))},
                      {"stage_seconds", report.stage_seconds},
                      {"warnings", report.warnings},
                      {"pose_faults", nlohmann::json::parse(to_json(report.pose_faults))},
                      {"digest", report.digest},
                      {"version", STILLMAP_VERSION}};
  if (!report.found_pose_time_offsets_s.empty())
    json["found_pose_time_offsets_s"] = report.found_pose_time_offsets_s;
  if (report.given_poses) json["given_poses"] = to_json(*report.given_poses);
  if (const auto& registration = report.registration)
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
