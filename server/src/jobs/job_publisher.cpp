#include "jobs/job_publisher.hpp"

#include "errors/api_error.hpp"
#include "jobs/job_request.hpp"
#include "json/json_values.hpp"

#include "store/store_refusal.hpp"

#include <optional>

namespace stillmap::server {
namespace {

/// What the report of a rebuild says of the gate.
struct GateVerdict {
  bool passed = false;
  std::vector<std::string> reasons;
  /// Verdict, reasons, warnings, figures, checks and held-back scans, as JSON.
  std::string json;
};

/// Nothing when there is no report, as for a job without a gate.
std::optional<GateVerdict> read_verdict(const JobFolder& folder) {
  const Json report = Json::parse(read_small_file(folder.report()).value_or(""), nullptr, false);
  if (!report.is_object() || !report.contains("verdict")) return std::nullopt;
  GateVerdict verdict;
  verdict.passed = report["verdict"] == "pass";
  for (const Json& reason : report.value("reasons", Json::array()))
    if (reason.is_string()) verdict.reasons.push_back(reason.get<std::string>());
  Json kept;
  for (const char* key :
       {"verdict", "reasons", "warnings", "figures", "checks", "held_back", "patch"})
    if (report.contains(key)) kept[key] = report[key];
  verdict.json = to_text(kept);
  return verdict;
}

}  // namespace

std::string to_json(const JobOutcome& outcome) {
  Json json{{"version", outcome.version},
            {"digest", outcome.digest},
            {"activated", outcome.activated},
            {"not_activated_because", outcome.not_activated_because}};
  json["gate"] = outcome.gate.empty() ? Json() : Json::parse(outcome.gate);
  return to_text(json);
}

JobOutcome JobPublisher::publish(const StoredJob& job, const std::stop_token& stop) {
  const auto is_unwanted = [&] {
    return stop.stop_requested() || setup_.store.jobs().job(job.id).cancel_requested;
  };
  const PackageStore::Added added = setup_.store.add(
      job.map, version_of(job), folders_.of(job.id).map(), PackageStore::Maker{job, is_unwanted});
  return activate(job, added.version);
}

JobOutcome JobPublisher::outcome_without_more(const StoredJob& job, const StoredVersion& version,
                                              const std::string& why) const {
  JobOutcome outcome{.version = version.name, .digest = version.digest};
  outcome.activated = setup_.store.state().map(job.map).active == version.name;
  if (!outcome.activated) outcome.not_activated_because.push_back(why);
  if (const auto gate = read_verdict(folders_.of(job.id))) outcome.gate = gate->json;
  return outcome;
}

JobOutcome JobPublisher::activate(const StoredJob& job, const StoredVersion& version) {
  JobOutcome outcome{.version = version.name, .digest = version.digest};
  if (job.kind != JobKind::kRebuild) return outcome;
  const RebuildRequest request = read_stored_rebuild(job.request);
  const JobFolder folder = folders_.of(job.id);
  const auto gate = read_verdict(folder);
  if (gate) outcome.gate = gate->json;
  if (!request.activate) return outcome;
  const StoredMap map = setup_.store.state().map(job.map);
  outcome.activated = map.active == version.name;
  if (outcome.activated) return outcome;
  if (!gate || !gate->passed) {
    if (gate) outcome.not_activated_because = gate->reasons;
    if (outcome.not_activated_because.empty())
      outcome.not_activated_because.emplace_back("the gate gave no verdict");
    return outcome;
  }
  // The verdict is about the version that was active when it began.
  const std::string judged_against = read_small_file(folder.previous()).value_or("");
  const std::string now =
      map.active ? setup_.store.state().version(map.name, *map.active).digest : std::string{};
  // Whoever changed the map since the first try, be it this job before a kill, has the last word.
  const std::int64_t revision = setup_.store.jobs().activates_at(job, map.revision);
  // It may have been migrated since.
  const bool is_same = setup_.store.state().current_digest(judged_against) == now;
  if (map.revision != revision || (!request.new_frame && !is_same)) {
    outcome.not_activated_because.emplace_back("another version became the active one meanwhile");
    return outcome;
  }
  try {
    setup_.catalog.activate(job.map, version.name, revision, request.new_frame);
    outcome.activated = true;
  } catch (const ApiError& error) {
    outcome.not_activated_because.emplace_back(error.what());
  } catch (const StoreRefusal& error) {
    outcome.not_activated_because.emplace_back(error.what());
  }
  return outcome;
}

}  // namespace stillmap::server
