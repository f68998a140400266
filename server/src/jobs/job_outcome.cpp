#include "jobs/job_outcome.hpp"

#include "json/json_values.hpp"

namespace stillmap::server {

std::string to_json(const JobOutcome& outcome) {
  Json json{{"version", outcome.version},
            {"digest", outcome.digest},
            {"activated", outcome.activated},
            {"not_activated_because", outcome.not_activated_because}};
  json["gate"] = outcome.gate.empty() ? Json() : Json::parse(outcome.gate);
  return to_text(json);
}

std::optional<GateReport> read_report(const std::string& text) {
  const Json report = Json::parse(text, nullptr, false);
  if (!report.is_object() || !report.contains("verdict")) return std::nullopt;
  GateReport gate;
  gate.passed = report["verdict"] == "pass";
  for (const Json& reason : report.value("reasons", Json::array()))
    if (reason.is_string()) gate.reasons.push_back(reason.get<std::string>());
  Json kept;
  for (const char* key : {"verdict", "reasons", "warnings", "figures", "checks", "held_back"})
    if (report.contains(key)) kept[key] = report[key];
  gate.json = to_text(kept);
  return gate;
}

}  // namespace stillmap::server
