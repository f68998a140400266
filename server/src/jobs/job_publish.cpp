#include "errors/api_error.hpp"
#include "jobs/job_runner.hpp"
#include "store/ids_and_times.hpp"

#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <nlohmann/json.hpp>

#include <stillmap/maps/error.hpp>
#include "store/disk_full.hpp"
#include "store/store_refusal.hpp"

#include <charconv>
#include <exception>
#include <filesystem>
#include <system_error>

namespace stillmap::server {
namespace {

/// The revision at which a job may make its version the active one: that of its first try. Whoever
/// changed the map since, be it this job before a kill, has the last word.
std::int64_t revision_to_change(const JobFolder& folder, const StoredMap& map) {
  const std::string noted = read_small_file(folder.activation()).value_or("");
  std::int64_t revision = 0;
  const char* const end = noted.data() + noted.size();
  if (!noted.empty() && std::from_chars(noted.data(), end, revision).ptr == end) return revision;
  write_small_file(folder.activation(), std::to_string(map.revision));
  return map.revision;
}

}  // namespace

/// Marks it. @throws StoreRefusal kNotProcessing when the server ends, which takes marks
/// away; maps::StorageError.
void JobRunner::begin_to_publish(const JobFolder& folder, const std::stop_token& stop) {
  const std::scoped_lock lock(mutex_);
  if (stop.stop_requested())
    throw StoreRefusal(StoreRefusal::Reason::kNotProcessing, "the server ends");
  write_small_file(folder.publishing(), "");
}

/// Publishes what the mapper made. Again after a kill, it comes to the same.
void JobRunner::publish(const StoredJob& job, const std::stop_token& stop) {
  const JobFolder folder = this->folder(job.id);
  note_progress(job, {.stage = "publish", .fraction = 1.0});
  JobOutcome outcome;
  try {
    begin_to_publish(folder, stop);
    const PackageStore::Added added = setup_.store.add(
        job.map, version_of(job), folder.map(),
        PackageStore::Maker{job.id, [&] { return stop.stop_requested() || is_canceled(job); }});
    outcome = activate(job, added.version);
    write_small_file(folder.outcome(), to_json(outcome));
    std::error_code error;
    std::filesystem::remove(folder.publishing(), error);
  } catch (const StoreRefusal& error) {
    if (error.reason() == StoreRefusal::Reason::kNotProcessing) return give_up_publishing(job);
    return fail(job, error.what());
  } catch (const DiskFull& error) {
    return try_again_with_room(job, error.what(), stop);
  } catch (const maps::InputError& error) {
    return fail(job, without_places(error.what()));
  } catch (const std::exception& error) {
    spdlog::error("job {}: {}", job.id, error.what());
    return try_again(job, "it could not be published: " + without_places(error.what()));
  }
  ended(setup_.store.jobs().succeed(job.id, outcome.version, unix_ns()));
}

/// Because it is cancelled, or to go on when the server starts again.
void JobRunner::give_up_publishing(const StoredJob& job) {
  std::error_code error;
  std::filesystem::remove(folder(job.id).publishing(), error);
  JobTable& jobs = setup_.store.jobs();
  ended(is_canceled(job) ? jobs.end_canceled(job.id, unix_ns())
                         : jobs.put_back(job.id, "the server was stopped", unix_ns()));
}

/// For good. One whose version is there has come that far, and says why it went no further.
void JobRunner::fail(const StoredJob& job, const std::string& why) {
  JobTable& jobs = setup_.store.jobs();
  const std::optional<std::string> name = jobs.job(job.id).result_version;
  const auto version = name ? setup_.store.state().find_version(job.map, *name) : std::nullopt;
  if (!version) return ended(jobs.fail(job.id, why, unix_ns()));
  JobOutcome outcome{.version = version->name, .digest = version->digest};
  outcome.activated = setup_.store.state().map(job.map).active == version->name;
  if (!outcome.activated) outcome.not_activated_because.push_back(why);
  const JobFolder folder = this->folder(job.id);
  const auto gate = read_report(read_small_file(folder.report()).value_or(""));
  if (gate) outcome.gate = gate->json;
  write_small_file(folder.outcome(), to_json(outcome));
  ended(jobs.succeed(job.id, version->name, unix_ns()));
}

JobOutcome JobRunner::activate(const StoredJob& job, const StoredVersion& version) {
  JobOutcome outcome{.version = version.name, .digest = version.digest};
  if (job.kind != JobKind::kRebuild) return outcome;
  const RebuildRequest request = read_stored_rebuild(job.request);
  const JobFolder folder = this->folder(job.id);
  const auto gate = read_report(read_small_file(folder.report()).value_or(""));
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
  const std::int64_t revision = revision_to_change(folder, map);
  if (map.revision != revision || (!request.new_frame && judged_against != now)) {
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
