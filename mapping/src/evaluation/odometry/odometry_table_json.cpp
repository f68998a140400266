#include <stillmap/mapping/odometry_table.hpp>

#include "evaluation/odometry/errors_json.hpp"
#include "evaluation/odometry/run_json.hpp"

namespace stillmap::mapping {
namespace {

using Json = nlohmann::ordered_json;

Json interval_json(const Interval& interval) {
  return {{"mean", number_json(interval.value)},
          {"interval_95", {number_json(interval.low), number_json(interval.high)}}};
}

Json drive_json(const OdometryTableDrive& drive) {
  Json json{{"name", drive.name}, {"scans", drive.scans}, {"way_m", number_json(drive.way_m)}};
  json["paper_m"] = drive.paper_m ? Json{{"without_removal", drive.paper_m->at(0)},
                                         {"paper_method", drive.paper_m->at(1)}}
                                  : Json(nullptr);
  return json;
}

Json difference_json(const OdometryTableDifference& difference) {
  return {{"odometry", difference.method},
          {"loops", difference.loops},
          {"points", points_name(difference.points)},
          {"against", "raw"},
          {"drives", difference.drives},
          {"better", difference.better},
          {"ape_mean_m", interval_json(difference.ape_mean_m)},
          {"translation_percent_10m", interval_json(difference.percent_10m)}};
}

Json options_json(const OdometryTableOptions& options) {
  Json json;
  const bool simulated = options.drives.empty() && !options.kitti;
  if (simulated) {
    // As text: a seed may exceed the 2^53 that readers of JSON keep exact.
    json["seeds"] = Json::array();
    for (const std::uint64_t seed : options.seeds) json["seeds"].push_back(std::to_string(seed));
    json["scans"] = options.scans;
    json["sensor"] = options.sensor;
    json["parked"] = options.parked_share ? Json(*options.parked_share) : Json(nullptr);
  }
  json["drives"] = Json::array();
  for (const auto& drive : options.drives) json["drives"].push_back(drive.string());
  json["kitti"] = options.kitti ? Json(options.kitti->string()) : Json(nullptr);
  json["sequences"] = options.sequences;
  json["detector"] = options.detector;
  json["methods"] = options.methods;
  json["threads"] = options.threads;
  json["program"] = options.program;
  return json;
}

}  // namespace

std::string to_json(const OdometryTable& table) {
  Json json;
  json["drives"] = Json::array();
  for (const OdometryTableDrive& drive : table.drives) json["drives"].push_back(drive_json(drive));
  json["table"] = Json::array();
  std::size_t scans = 0;
  for (const OdometryTableRun& run : table.runs) json["table"].push_back(run_json(run));
  for (const OdometryTableDrive& drive : table.drives) scans += drive.scans;
  json["differences"] = Json::array();
  for (const OdometryTableDifference& difference : table.differences)
    json["differences"].push_back(difference_json(difference));
  json["missing_sequences"] = table.missing;
  json["scans"] = scans;
  json["seconds"] = table.seconds;
  json["options"] = options_json(table.options);
  return json.dump(2);
}

}  // namespace stillmap::mapping
