#include <stillmap/mapping/paper_evaluation.hpp>

#include "evaluation/paper/paper_figures.hpp"

#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

namespace stillmap::mapping {
namespace {

using Json = nlohmann::ordered_json;

Json number(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

void add_interval(Json& json, const std::string& name, const std::string& interval_name,
                  const Interval& interval) {
  json[name] = number(interval.value);
  json[interval_name] = {number(interval.low), number(interval.high)};
}

void add_errors(Json& json, const Interval& xy_m, const Interval& yaw_rad) {
  add_interval(json, "rmse_xy_m", "rmse_xy_interval_95", xy_m);
  add_interval(json, "rmse_yaw_rad", "rmse_yaw_interval_95", yaw_rad);
  json["rmse_yaw_deg"] = number(yaw_rad.value * 180.0 / std::numbers::pi);
}

Json street_json(const std::string& name, const PaperAnswers& street) {
  std::size_t lost = 0;
  for (const PaperAnswer& answer : street.scans)
    lost += answer.status == localization::PoseStatus::kLost ? 1 : 0;
  return {
      {"name", name},
      {"rmse_xy_m", number(street_rmse_xy_m(street))},
      {"rmse_yaw_rad", number(street_rmse_yaw_rad(street))},
      {"queries", street.scans.size()},
      {"lost", lost},
      {"map_digest", street.map_digest},
      {"map_points",
       {{"measured", street.measured}, {"projected", street.projected}, {"filled", street.filled}}},
      {"query_points", street.query_points},
      {"query_deleted", street.query_deleted},
      {"cpu_ms", number(street.cpu_ms)}};
}

Json row_json(const PaperRow& row, const std::vector<std::string>& streets) {
  Json json{{"method", row.method}, {"query", row.query}, {"map", row.map}};
  json["queries"] = row.queries;
  json["status"] = {{"ok", row.queries - row.degraded - row.lost},
                    {"degraded", row.degraded},
                    {"lost", row.lost}};
  add_interval(json, "success_rate", "success_interval_95", row.success_rate);
  add_errors(json, row.rmse_xy_m, row.rmse_yaw_rad);
  json["answered"] = {{"rmse_xy_m", number(row.answered_rmse_xy_m)},
                      {"rmse_yaw_rad", number(row.answered_rmse_yaw_rad)}};
  json["streets"] = Json::array();
  for (std::size_t i = 0; i < streets.size(); ++i)
    json["streets"].push_back(street_json(streets[i], row.streets.at(i)));
  return json;
}

Json difference_json(const PaperDifference& difference) {
  Json json{{"method", difference.method},
            {"query", difference.query},
            {"map", difference.map},
            {"against", difference.against}};
  add_errors(json, difference.rmse_xy_m, difference.rmse_yaw_rad);
  json["better_streets"] = {
      {"xy", difference.better_xy}, {"yaw", difference.better_yaw}, {"of", difference.streets}};
  return json;
}

Json options_json(const PaperEvaluationOptions& options) {
  Json json;
  if (options.drives.empty()) {
    // As text: a seed may exceed the 2^53 that readers of JSON keep exact.
    json["seeds"] = Json::array();
    for (const std::uint64_t seed : options.seeds) json["seeds"].push_back(std::to_string(seed));
    json["scans"] = options.scans;
    json["sensor"] = options.sensor;
    json["parked"] = options.parked_share ? Json(*options.parked_share) : Json(nullptr);
  }
  json["drives"] = Json::array();
  for (const auto& [map, query] : options.drives)
    json["drives"].push_back({map.string(), query.string()});
  json["detector"] = options.detector;
  json["maps"] = options.maps;
  json["methods"] = options.methods;
  json["threads"] = options.threads;
  json["program"] = options.program;
  return json;
}

}  // namespace

std::string to_json(const PaperEvaluation& evaluation) {
  Json json;
  json["table"] = Json::array();
  for (const PaperRow& row : evaluation.rows)
    json["table"].push_back(row_json(row, evaluation.streets));
  json["differences"] = Json::array();
  for (const PaperDifference& difference : evaluation.differences)
    json["differences"].push_back(difference_json(difference));
  json["scans"] = evaluation.scans;
  json["seconds"] = evaluation.seconds;
  json["options"] = options_json(evaluation.options);
  return json.dump(2);
}

}  // namespace stillmap::mapping
