#include <nlohmann/json.hpp>
#include <stillmap/mapping/map_build.hpp>

namespace stillmap::mapping {
namespace {

nlohmann::json to_json(const Eigen::Isometry3d& T) {
  const Eigen::Vector3d p = T.translation();
  const Eigen::Quaterniond q(T.linear());
  return {{"position", {p.x(), p.y(), p.z()}}, {"quaternion", {q.x(), q.y(), q.z(), q.w()}}};
}

}  // namespace

std::string to_json(const MapBuildReport& report) {
  nlohmann::json json{{"scans", report.scans},
                      {"resumed_scans", report.resumed_scans},
                      {"seconds", report.seconds},
                      {"scans_per_second", report.scans_per_second},
                      {"peak_rss_mib", report.peak_rss_mib},
                      {"points", report.points},
                      {"objects", report.objects},
                      {"trajectory", report.trajectory},
                      {"stage_seconds", report.stage_seconds},
                      {"warnings", report.warnings},
                      {"digest", report.digest},
                      {"version", STILLMAP_VERSION}};
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
