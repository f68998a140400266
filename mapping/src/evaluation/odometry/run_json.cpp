#include "evaluation/odometry/run_json.hpp"

#include "evaluation/odometry/errors_json.hpp"

#include <limits>
#include <string>

namespace stillmap::mapping {
namespace {

using Json = nlohmann::ordered_json;

double number_of(const Json& json) {
  return json.is_null() ? std::numeric_limits<double>::quiet_NaN() : json.get<double>();
}

Json figures_json(const PathFigures& figures) {
  return {{"ape_mean_m", number_json(figures.ape_mean_m)},
          {"ate_rmse_m", number_json(figures.ate_rmse_m)},
          {"kitti",
           {{"translation_percent", number_json(figures.kitti_percent)},
            {"rotation_deg_per_100m", number_json(figures.kitti_deg_per_100m)}}},
          {"rpe",
           {{"translation_percent_10m", number_json(figures.percent_10m)},
            {"rotation_deg_10m", number_json(figures.deg_10m)}}}};
}

PathFigures figures_from(const Json& json) {
  return {.ape_mean_m = number_of(json.at("ape_mean_m")),
          .ate_rmse_m = number_of(json.at("ate_rmse_m")),
          .kitti_percent = number_of(json.at("kitti").at("translation_percent")),
          .kitti_deg_per_100m = number_of(json.at("kitti").at("rotation_deg_per_100m")),
          .percent_10m = number_of(json.at("rpe").at("translation_percent_10m")),
          .deg_10m = number_of(json.at("rpe").at("rotation_deg_10m"))};
}

MovablePolicy points_from(const std::string& name) {
  for (const MovablePolicy points : {MovablePolicy::kProject, MovablePolicy::kDelete}) {
    if (name == points_name(points)) return points;
  }
  return MovablePolicy::kKeep;
}

}  // namespace

std::string points_name(MovablePolicy points) {
  switch (points) {
    case MovablePolicy::kProject:
      return "projected";
    case MovablePolicy::kDelete:
      return "deleted";
    case MovablePolicy::kKeep:
      break;
  }
  return "raw";
}

Json run_json(const OdometryTableRun& run) {
  const auto share = [](std::size_t count, std::size_t of) {
    return of == 0 ? Json(nullptr) : Json(static_cast<double>(count) / static_cast<double>(of));
  };
  return {
      {"drive", run.drive},
      {"scans", run.scans},
      {"way_m", number_json(run.way_m)},
      {"odometry", run.method},
      {"points", points_name(run.points)},
      {"without_loops", figures_json(run.without_loops)},
      {"with_loops", figures_json(run.with_loops)},
      {"loops",
       {{"found", run.loops_found},
        {"precision", share(run.loops_right, run.loops_found)},
        {"recall", share(run.revisits_found, run.revisits)},
        {"right", run.loops_right},
        {"revisits", run.revisits},
        {"revisits_found", run.revisits_found}}},
      {"status", {{"matched", run.matched}, {"partly", run.partly}, {"predicted", run.predicted}}},
      {"treated",
       {{"in", run.treated.in},
        {"projected", run.treated.projected},
        {"deleted", run.treated.deleted}}},
      {"scans_per_second", number_json(run.scans_per_second)}};
}

OdometryTableRun run_of(const Json& json) {
  OdometryTableRun run;
  run.drive = json.at("drive");
  run.scans = json.at("scans");
  run.way_m = number_of(json.at("way_m"));
  run.method = json.at("odometry");
  run.points = points_from(json.at("points"));
  run.without_loops = figures_from(json.at("without_loops"));
  run.with_loops = figures_from(json.at("with_loops"));
  run.loops_found = json.at("loops").at("found");
  run.loops_right = json.at("loops").at("right");
  run.revisits = json.at("loops").at("revisits");
  run.revisits_found = json.at("loops").at("revisits_found");
  run.matched = json.at("status").at("matched");
  run.partly = json.at("status").at("partly");
  run.predicted = json.at("status").at("predicted");
  run.treated.in = json.at("treated").at("in");
  run.treated.projected = json.at("treated").at("projected");
  run.treated.deleted = json.at("treated").at("deleted");
  run.scans_per_second = number_of(json.at("scans_per_second"));
  return run;
}

}  // namespace stillmap::mapping
