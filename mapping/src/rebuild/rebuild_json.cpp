#include <stillmap/mapping/rebuild.hpp>

#include <cmath>
#include <nlohmann/json.hpp>

namespace stillmap::mapping {
namespace {

using Json = nlohmann::ordered_json;

Json number(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

Json share_json(std::size_t part, std::size_t whole) {
  return whole == 0 ? Json(nullptr) : Json(static_cast<double>(part) / static_cast<double>(whole));
}

Json answers_json(const HeldBackAnswers& answers) {
  return {{"queries", answers.queries},
          {"found", answers.found},
          {"success_rate", share_json(answers.found, answers.queries)},
          {"false_ok_rate", share_json(answers.false_ok, answers.queries)},
          {"status", {{"ok", answers.ok}, {"degraded", answers.degraded}, {"lost", answers.lost}}}};
}

Json figures_json(const RebuildResult& result) {
  Json json;
  json["map"] = answers_json(result.answers);
  json["keep"] = answers_json(result.keep_answers);
  json["previous"] = result.previous_answers ? answers_json(*result.previous_answers) : Json();
  json["static_loss"] = number(result.figures.static_loss);
  json["static_points"] = result.static_points;
  json["static_points_lost"] = result.static_points_lost;
  const auto& previous = result.figures.previous;
  json["new_lost"] = previous ? Json(previous->new_lost) : Json();
  json["driven_coverage"] = previous ? number(previous->driven_coverage) : Json();
  json["ground_coverage"] = previous ? number(previous->ground_coverage) : Json();
  json["consistency"] = Json();
  if (previous) {
    json["consistency"] = {{"map", Json::parse(to_json(previous->consistency_now))},
                           {"previous", Json::parse(to_json(previous->consistency_before))}};
  }
  return json;
}

Json limits_json(const GateLimits& limits) {
  return {{"least_queries", limits.least_queries},
          {"least_found_in_keep", limits.least_found_in_keep},
          {"found_below_keep", limits.found_below_keep},
          {"new_lost", limits.new_lost},
          {"static_loss", limits.static_loss},
          {"driven_coverage", limits.driven_coverage},
          {"ground_coverage", limits.ground_coverage},
          {"wall_thickening", limits.wall_thickening},
          {"entropy_rise", limits.entropy_rise},
          {"first_found", limits.first_found}};
}

Json checks_json(const GateVerdict& verdict) {
  Json checks = Json::array();
  for (const GateCheck& check : verdict.checks)
    checks.push_back({{"name", check.name},
                      {"found", number(check.found)},
                      {"limit", number(check.limit)},
                      {"passed", check.passed},
                      {"words", check.words}});
  return checks;
}

}  // namespace

std::string to_json(const RebuildResult& result, const RebuildOptions& options) {
  Json json;
  json["verdict"] = result.verdict.passed ? "pass" : "fail";
  json["reasons"] = result.verdict.reasons;
  json["warnings"] = result.warnings;
  json["digest"] = result.digest;
  json["keep_digest"] = result.keep_digest;
  json["previous_digest"] =
      result.previous_digest.empty() ? Json(nullptr) : Json(result.previous_digest);
  json["patch"] = result.patch ? Json::parse(to_json(*result.patch)) : Json(nullptr);
  json["held_back"] = {{"from", options.held_back ? "drive" : "every_nth"},
                       {"every", options.held_back ? Json(nullptr) : Json(options.held_back_every)},
                       {"scans", result.answers.queries},
                       {"prior_error_m", kGatePriorErrorM},
                       {"prior_error_deg", kGatePriorErrorDeg},
                       {"seed", std::to_string(kGateSeed)}};
  json["figures"] = figures_json(result);
  json["checks"] = checks_json(result.verdict);
  json["limits"] = limits_json(options.limits);
  json["map_bytes"] = result.map_bytes;
  json["work_bytes"] = result.work_bytes;
  json["stage_seconds"] = result.stage_seconds;
  json["resumed_stages"] = result.resumed_stages;
  json["peak_rss_mib"] = result.peak_rss_mib;
  return json.dump(2);
}

std::string to_json(const RebuildEstimate& estimate) {
  Json json;
  json["bytes"] = estimate.bytes();
  json["package_bytes"] = estimate.package_bytes;
  json["work_bytes"] = estimate.work_bytes;
  json["scans"] = estimate.scans;
  json["points"] = estimate.points;
  return json.dump(2);
}

}  // namespace stillmap::mapping
