#include <stillmap/mapping/localization_evaluation.hpp>

#include <nlohmann/json.hpp>

#include <cmath>

namespace stillmap::mapping {
namespace {

using Json = nlohmann::ordered_json;

Json finite_or_null(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

void add_rate(Json& json, const std::string& name, const BoundedRate& rate) {
  json[name] = finite_or_null(rate.rate);
  json[name + "_count"] = rate.count;
  json[name + "_of"] = rate.of;
  json[name + "_upper_95"] = finite_or_null(rate.upper_95);
}

Json integrity_json(const Integrity& integrity) {
  Json json;
  add_rate(json, "misleading", integrity.misleading);
  add_rate(json, "hazardous", integrity.hazardous);
  add_rate(json, "availability", integrity.availability);
  json["availability_lower_95"] = finite_or_null(integrity.availability_lower_95);
  json["level_over_error"] = finite_or_null(integrity.level_over_error);
  return json;
}

Json level_json(const LocalizationLevel& level) {
  Json json;
  json["prior_error_m"] = finite_or_null(level.prior_error.metres);
  json["prior_error_deg"] = finite_or_null(level.prior_error.degrees);
  json["queries"] = level.queries;
  json["success_rate"] = finite_or_null(level.success_rate);
  json["success_interval_95"] = {finite_or_null(level.success_interval[0]),
                                 finite_or_null(level.success_interval[1])};
  json["status"] = {{"ok", level.ok}, {"degraded", level.degraded}, {"lost", level.lost}};
  json["reasons"] = Json::object();
  for (const auto& [reason, count] : level.reasons)
    json["reasons"][std::string(localization::name_of(reason))] = count;
  json["false_ok_rate"] = finite_or_null(level.false_ok_rate);
  json["translation_error_m"] = {{"median", finite_or_null(level.translation_m.median)},
                                 {"p95", finite_or_null(level.translation_m.p95)},
                                 {"rmse_xy", finite_or_null(level.translation_m.rmse_part)}};
  json["rotation_error_deg"] = {{"median", finite_or_null(level.rotation_deg.median)},
                                {"p95", finite_or_null(level.rotation_deg.p95)},
                                {"rmse_yaw", finite_or_null(level.rotation_deg.rmse_part)}};
  json["cpu_ms"] = {{"p50", finite_or_null(level.cpu_ms.p50)},
                    {"p95", finite_or_null(level.cpu_ms.p95)}};
  json["wall_ms"] = {{"p50", finite_or_null(level.wall_ms.p50)},
                     {"p95", finite_or_null(level.wall_ms.p95)}};
  json["nees"] = {{"mean", finite_or_null(level.nees_mean)},
                  {"inside_95", finite_or_null(level.nees_inside_95)}};
  json["integrity"] = integrity_json(level.integrity);
  return json;
}

std::string text_of(const maps::Selection& selection) {
  return std::to_string(selection.begin) + ":" +
         (selection.end ? std::to_string(*selection.end) : "") + ":" +
         std::to_string(selection.step);
}

}  // namespace

std::string to_json(const LocalizationEvaluation& evaluation) {
  Json json;
  json["levels"] = Json::array();
  for (const LocalizationLevel& level : evaluation.levels)
    json["levels"].push_back(level_json(level));
  json["scans"] = evaluation.scans;
  json["points"] = {{"in", evaluation.points.in},
                    {"projected", evaluation.points.projected},
                    {"deleted", evaluation.points.deleted},
                    {"without_ground", evaluation.points.without_ground}};
  json["seconds"] = evaluation.seconds;
  // As text: a seed may exceed the 2^53 that readers of JSON keep exact.
  json["options"] = {{"select", text_of(evaluation.options.selection)},
                     {"prior", name_of(evaluation.options.prior)},
                     {"bias", name_of(evaluation.options.bias)},
                     {"query_deskew", name_of(evaluation.options.query_deskew)},
                     {"query_movable", name_of(evaluation.options.query_movable)},
                     {"query_detector", evaluation.options.query_detector},
                     {"trials", evaluation.options.trials},
                     {"seed", std::to_string(evaluation.options.seed)},
                     {"threads", evaluation.options.threads}};
  if (const auto& sigma = evaluation.options.prior_sigma)
    json["options"]["prior_sigma"] = {{"metres", sigma->metres}, {"degrees", sigma->degrees}};
  return json.dump(2);
}

}  // namespace stillmap::mapping
