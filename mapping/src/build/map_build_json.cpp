#include <nlohmann/json.hpp>
#include <stillmap/mapping/map_build.hpp>

namespace stillmap::mapping {

std::string to_json(const MapBuildReport& report) {
  return nlohmann::json{{"scans", report.scans},
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
                        {"version", STILLMAP_VERSION}}
      .dump(2);
}

}  // namespace stillmap::mapping
