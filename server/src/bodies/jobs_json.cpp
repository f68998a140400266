#include "bodies/jobs_json.hpp"

#include "json/json_values.hpp"

#include <cstddef>
#include <utility>

namespace stillmap::server {
namespace {

/// Corrections can be as long as the map has objects: they are counted, not repeated.
struct ShownRequest {
  Json request{};
  Json edits{};
};

ShownRequest shown_request(const StoredJob& job) {
  ShownRequest shown{.request = Json::parse(job.request, nullptr, false)};
  Json& request = shown.request;
  if (!request.is_object()) return {};
  if (job.kind != JobKind::kRebuild) return shown;
  std::size_t count = 0;
  if (request.contains("options") && request["options"].is_object()) {
    Json& options = request["options"];
    if (options.contains("edits") && options["edits"].is_object())
      count = options["edits"].value("edits", Json::array()).size();
    options.erase("edits");
    if (options.empty()) request.erase("options");
  }
  const char* const before_they_were_saved = count > 0 ? "request" : "none";
  shown.edits = {{"source", request.value("edits_from", before_they_were_saved)}, {"count", count}};
  request.erase("edits_from");
  return shown;
}

Json progress_of(const JobView& view) {
  switch (view.job.status) {
    case JobStatus::kEnqueued:
      return 0.0;
    case JobStatus::kProcessing:
      return view.progress ? view.progress->fraction : 0.0;
    case JobStatus::kSucceeded:
      return 1.0;
    case JobStatus::kFailed:
    case JobStatus::kCanceled:
      break;
  }
  return {};
}

Json eta_of(const JobView& view) {
  const bool known = view.progress && view.progress->eta_s;
  return known ? Json(*view.progress->eta_s) : Json();
}

Json result_of(const JobView& view) {
  if (view.job.status != JobStatus::kSucceeded) return {};
  Json result = Json::parse(view.outcome, nullptr, false);
  if (result.is_object()) return result;
  return {{"version", *view.job.result_version}};
}

/// What changes while it is done.
Json state_of(const JobView& view) {
  return {{"status", name_of(view.job.status)},
          {"stage", view.job.stage},
          {"progress", progress_of(view)},
          {"eta_s", eta_of(view)},
          {"error", view.job.error}};
}

Json to_json(const JobView& view) {
  const StoredJob& job = view.job;
  Json json{{"id", job.id}, {"kind", name_of(job.kind)}, {"map", job.map}};
  json.update(state_of(view));
  json["attempts"] = job.attempts;
  json["cancel_requested"] = job.cancel_requested;
  json["enqueued_ns"] = time_of(job.enqueued_ns);
  json["started_ns"] = time_of(job.started_ns);
  json["finished_ns"] = time_of(job.finished_ns);
  json["key_id"] = job.asker;
  ShownRequest shown = shown_request(job);
  json["request"] = std::move(shown.request);
  json["edits"] = std::move(shown.edits);
  json["result"] = result_of(view);
  return json;
}

}  // namespace

std::string job_json(const JobView& view) { return to_text(to_json(view)); }

std::string job_list_json(const std::vector<JobView>& jobs, std::optional<std::int64_t> next) {
  Json json;
  json["jobs"] = Json::array();
  for (const JobView& each : jobs) json["jobs"].push_back(to_json(each));
  json["next"] = next ? Json(*next) : Json();
  return to_text(json);
}

std::string job_event_json(const JobView& view) {
  Json json = state_of(view);
  json["result"] = result_of(view);
  return to_text(json);
}

}  // namespace stillmap::server
