#include "jobs/job_runner.hpp"

#include "errors/refusal_codes.hpp"
#include "jobs/job_request.hpp"
#include "jobs/job_sources.hpp"
#include "jobs/mapper_command.hpp"
#include "store/ids_and_times.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <sys/file.h>

#include <stillmap/maps/error.hpp>
#include "store/disk_full.hpp"
#include "store/store_refusal.hpp"

#include <algorithm>
#include <chrono>
#include <exception>
#include <filesystem>
#include <stdexcept>
#include <system_error>
#include <utility>

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

/// How soon a job is seen, or its cancel, that another process wrote into the store.
constexpr std::chrono::seconds kLookAtStore{1};
/// How soon the jobs of another server are taken over when it is gone.
constexpr std::chrono::seconds kLookAtLock{2};
/// How soon the end of a job that could not be kept is tried again, at most.
constexpr std::chrono::seconds kMostBetweenTries{30};
/// How often a job waits for room on a full disk: with the pauses, for half an hour, in which what
/// it has made so far takes room itself.
constexpr int kMostTimesFull = 5;
constexpr int kLongerWhenFull = 5;

}  // namespace

JobRunner::JobRunner(const JobSetup& setup, const JobFolders& folders, JobUploads& uploads,
                     LiveJobs& live)
    : setup_(setup),
      folders_(folders),
      uploads_(uploads),
      live_(live),
      publisher_(setup, folders),
      room_(setup, folders) {
  if (!setup_.store.read_only_because().empty()) return;
  if (setup_.mapper.empty()) spdlog::warn("stillmap-mapper is not there: jobs will fail");
  for (int i = 0; i < setup_.live.current()->jobs.concurrent; ++i)
    threads_.emplace_back([this](const std::stop_token& stop) { work(stop); });
  threads_.emplace_back([this](const std::stop_token& stop) { watch(stop); });
}

JobRunner::~JobRunner() {
  for (std::jthread& thread : threads_) thread.request_stop();
  wake();
  // The last one says beats, of which an excuse is the last.
  if (!threads_.empty()) threads_.pop_back();
  for (const auto& [claim, advance] : live_.under_way()) {
    try {
      setup_.store.jobs().excuse(claim);
    } catch (const StoreRefusal&) {
      // It has ended.
    } catch (const std::exception& error) {
      spdlog::warn("job {}: its server's end counts as a crash: {}", claim.id, error.what());
    }
  }
  threads_.clear();
  live_.close();
}

void JobRunner::wake() {
  const std::scoped_lock lock(mutex_);
  ++wakes_;
  changed_.notify_all();
}

void JobRunner::work(const std::stop_token& stop) {
  std::uint64_t seen = 0;
  while (!stop.stop_requested()) {
    std::chrono::seconds pause = kLookAtStore;
    try {
      if (!take_over()) {
        pause = kLookAtLock;
      } else if (const auto job = setup_.store.jobs().claim(unix_ns(), server_, files_at_)) {
        run(*job, stop);
        continue;
      }
    } catch (const std::exception& error) {
      spdlog::error("jobs: {}", error.what());
    }
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, stop, pause, [&] { return wakes_ != seen; });
    seen = wakes_;
  }
}

/// Whether the jobs of this store are ours to do. What a server left that was killed is put back.
bool JobRunner::take_over() {
  const std::scoped_lock lock(take_over_mutex_);
  if (!locks_.empty()) return true;
  // Those of the store belong to one server, wherever each of them works; and a folder to work in
  // to one store, as jobs are known there by their numbers.
  const fs::path of_store = folders_.of_store();
  fs::create_directories(of_store);
  fs::create_directories(folders_.root());
  std::vector<fs::path> folders = {of_store};
  if (!fs::equivalent(of_store, folders_.root())) folders.push_back(folders_.root());
  std::vector<Descriptor> held;
  for (const fs::path& folder : folders) {
    Descriptor file(::open((folder / ".lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0640));
    if (!file.is_open() || ::flock(file.get(), LOCK_EX | LOCK_NB) != 0) return false;
    held.push_back(std::move(file));
  }
  server_ = folders_.server();
  files_at_.clear();
  if (setup_.store.state().is_shared()) {
    files_at_ = {server_, folders_.server_of_drives()};
    spdlog::info("jobs: this is server {}", server_);
  }
  const std::size_t back = setup_.store.jobs().put_back_all(
      "its server ended while it worked on it", unix_ns(), server_);
  if (back > 0) spdlog::info("{} jobs go on that were interrupted", back);
  // Whoever held the lock before is gone.
  uploads_.clear_left_by_another();
  folders_.clear_forgotten();
  locks_ = std::move(held);
  return true;
}

void JobRunner::watch(const std::stop_token& stop) {
  const std::chrono::milliseconds between_beats = setup_.silent_after / 6;
  std::optional<std::chrono::steady_clock::time_point> last_beat;
  while (!stop.stop_requested()) {
    try {
      look_for_cancels();
      const auto now = std::chrono::steady_clock::now();
      if (!last_beat || now - *last_beat >= between_beats) {
        last_beat = now;
        say_what_is_ours();
        take_over_silent();
      }
    } catch (const std::exception& error) {
      spdlog::warn("jobs: {}", error.what());
      // Who said nothing meanwhile may have been heard by nobody.
      silent_since_.clear();
    }
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, stop, std::min<std::chrono::milliseconds>(between_beats, kLookAtStore),
                      [] { return false; });
  }
}

/// That were asked for at other servers.
void JobRunner::look_for_cancels() {
  if (live_.under_way().empty()) return;
  for (const std::int64_t id : setup_.store.jobs().cancel_requests()) live_.note_cancel(id);
}

void JobRunner::say_what_is_ours() {
  for (const auto& [claim, advance] : live_.under_way()) {
    if (setup_.store.jobs().beat(claim, advance)) continue;
    spdlog::warn("job {}: attempt {} was given up", claim.id, claim.attempt);
    live_.lose(claim);
  }
}

/// By this server's own clock: those of others need not agree with it.
void JobRunner::take_over_silent() {
  const auto now = std::chrono::steady_clock::now();
  const std::map<JobClaim, JobAdvance> ours = live_.under_way();
  std::map<JobTable::Beat, std::chrono::steady_clock::time_point> seen;
  for (const JobTable::Beat& beat : setup_.store.jobs().beats()) {
    if (ours.contains(beat.claim)) continue;
    const auto known = silent_since_.find(beat);
    const auto since = known == silent_since_.end() ? now : known->second;
    if (now - since < setup_.silent_after) {
      seen[beat] = since;
    } else if (setup_.store.jobs().put_back_silent(beat, "its server has gone silent", unix_ns())) {
      spdlog::warn("job {}: its server has gone silent, it is tried again", beat.claim.id);
      wake();
    }
  }
  silent_since_ = std::move(seen);
}

void JobRunner::run(const StoredJob& job, const std::stop_token& stop) {
  spdlog::info("job {} begins: {} of {}, attempt {}", job.id, name_of(job.kind), job.map,
               job.attempts);
  const AttemptEnd end = live_.begin(job, stop)
                             ? attempt(job, stop)
                             : AttemptEnd{AttemptEnd::Kind::kStopped, "the server was stopped"};
  // What the store cannot keep just now, as on a full disk, is tried until the server ends; at its
  // next start the job is put back.
  std::chrono::seconds pause = kLookAtStore;
  do {
    try {
      return conclude(job, end, stop);
    } catch (const StoreRefusal& refusal) {
      // Somebody else has ended or forgotten it.
      spdlog::error("job {}: {}", job.id, refusal.what());
      return live_.forget(job);
    } catch (const std::exception& error) {
      spdlog::error("job {}: its end could not be kept: {}", job.id, error.what());
    }
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, stop, pause, [] { return false; });
    pause = std::min(2 * pause, kMostBetweenTries);
  } while (!stop.stop_requested());
}

AttemptEnd JobRunner::attempt(const StoredJob& job, const std::stop_token& stop) {
  // Else a job that is too large for its server would end it again and again.
  if (job.crashes > setup_.live.current()->jobs.retries)
    return {
        AttemptEnd::Kind::kFailed,
        fmt::format("{}, {} times: ask again with less at a time, or give the server more memory",
                    job.error, job.crashes)};
  JobAttempt attempt{
      .command = {},
      .limits = setup_.limits(),
      .log = folders_.of(job.id).log(),
      .most = std::chrono::seconds(setup_.live.current()->jobs.time_limit_s),
      .is_canceled = [&] { return live_.wants_cancel(job); },
      .is_stopping = [&] { return stop.stop_requested(); },
      .on_progress = [&](const JobProgress& progress) { live_.note_progress(job, progress); },
      .leaves_jobs = {}};
  using Kind = AttemptEnd::Kind;
  AttemptEnd unprepared;
  try {
    // This server follows them when it is back, or another one in its folder does.
    if (runs_in_cluster(setup_.live.current()->jobs))
      attempt.leaves_jobs = [&] { return stop.stop_requested(); };
    attempt.command = prepare(job, [&] { return attempt.is_canceled() || attempt.is_stopping(); });
    return run_attempt(attempt);
  } catch (const ProgramCrash& error) {
    unprepared = {Kind::kCrashed, error.what()};
  } catch (const DiskFull& error) {
    unprepared = {Kind::kDiskFull, error.what()};
  } catch (const fs::filesystem_error& error) {
    unprepared = {is_disk_full(error) ? Kind::kDiskFull : Kind::kFailed, error.what()};
  } catch (const std::exception& error) {
    unprepared = {Kind::kFailed, error.what()};
  }
  if (attempt.is_canceled()) return {Kind::kCanceled, "cancelled"};
  if (attempt.is_stopping()) return {Kind::kStopped, "the server was stopped"};
  return unprepared;
}

std::vector<std::string> JobRunner::prepare(const StoredJob& job,
                                            const std::function<bool()>& is_unwanted) {
  const JobFolder folder = folders_.of(job.id);
  fs::create_directories(folder.scratch());
  sync_folder(folders_.root());
  if (setup_.mapper.empty()) throw std::runtime_error("stillmap-mapper is not there");
  const JobOptions options = setup_.live.current()->jobs;
  if (job.kind == JobKind::kConvert) {
    // It has no checkpoints: half a map would be in the way.
    clear_folder(folder.map());
    const ConvertRequest request = read_convert_request(job.request);
    const fs::path file = folder.scratch() / ("map." + request.format);
    std::error_code error;
    fs::remove(file, error);
    fs::create_hard_link(uploads_.file(request.sha256), file);
    return convert_command(setup_.mapper, file, folder, options.cores);
  }
  const RebuildRequest request = read_stored_rebuild(job.request);
  const RebuildSources sources = sources_of_job(setup_, job.map, request, folder);
  // A second attempt has used some of it.
  if (job.attempts == 1) {
    room_.check(job.map, request, sources, std::chrono::seconds(options.time_limit_s), is_unwanted);
  }
  write_small_file(folder.gate(), gate_json(setup_.live.current()->gate));
  if (!request.edits.empty()) write_small_file(folder.edits(), request.edits);
  return rebuild_command(setup_.mapper, request, sources, folder, options);
}

/// By whomever: another process may have written so into the store.
bool JobRunner::is_canceled(const StoredJob& job) const {
  return setup_.store.jobs().job(job.id).cancel_requested;
}

void JobRunner::conclude(const StoredJob& job, const AttemptEnd& end, const std::stop_token& stop) {
  using Kind = AttemptEnd::Kind;
  JobTable& jobs = setup_.store.jobs();
  switch (end.kind) {
    case Kind::kDone:
      if (live_.wants_cancel(job)) return live_.end(jobs.end_canceled(job, unix_ns()));
      return publish(job, stop);
    case Kind::kFailed:
    case Kind::kTimedOut:
      return fail(job, folders_.without_places(end.why));
    case Kind::kCanceled:
      return live_.end(jobs.end_canceled(job, unix_ns()));
    case Kind::kStopped:
      return live_.end(jobs.put_back(job, end.why, unix_ns()));
    case Kind::kCrashed:
      return try_again(job, end.why);
    case Kind::kDiskFull:
      return try_again_with_room(job, end.why, stop);
  }
}

void JobRunner::publish(const StoredJob& job, const std::stop_token& stop) {
  live_.note_progress(job, {.stage = "publish", .fraction = 1.0});
  JobOutcome outcome;
  try {
    outcome = publisher_.publish(job, stop);
  } catch (const StoreRefusal& error) {
    if (error.reason() == StoreRefusal::Reason::kNotProcessing) return give_up_publishing(job);
    return fail(job, error.what());
  } catch (const DiskFull& error) {
    return try_again_with_room(job, error.what(), stop);
  } catch (const maps::InputError& error) {
    return fail(job, folders_.without_places(error.what()));
  } catch (const std::exception& error) {
    spdlog::error("job {}: {}", job.id, error.what());
    return try_again(job, "it could not be published: " + folders_.without_places(error.what()));
  }
  live_.end(setup_.store.jobs().succeed(job, outcome.version, unix_ns(), to_json(outcome)));
}

/// Because it is cancelled, or to go on when the server starts again.
void JobRunner::give_up_publishing(const StoredJob& job) {
  JobTable& jobs = setup_.store.jobs();
  live_.end(is_canceled(job) ? jobs.end_canceled(job, unix_ns())
                             : jobs.put_back(job, "the server was stopped", unix_ns()));
}

/// For good. One whose version is there has come that far, and says why it went no further.
void JobRunner::fail(const StoredJob& job, const std::string& why) {
  JobTable& jobs = setup_.store.jobs();
  const std::optional<std::string> name = jobs.job(job.id).result_version;
  const auto version = name ? setup_.store.state().find_version(job.map, *name) : std::nullopt;
  if (!version) return live_.end(jobs.fail(job, why, unix_ns()));
  live_.end(jobs.succeed(job, version->name, unix_ns(),
                         to_json(publisher_.outcome_without_more(job, *version, why))));
}

/// As often as the options allow; then it has failed.
void JobRunner::try_again(const StoredJob& job, const std::string& why) {
  const std::int64_t crashes = job.crashes + 1;
  const std::string words = folders_.without_places(why);
  if (crashes > setup_.live.current()->jobs.retries)
    return fail(job, fmt::format("{}, {} times", words, crashes));
  spdlog::warn("job {} is tried again: {}", job.id, words);
  live_.end(setup_.store.jobs().put_back(job, words, unix_ns(), JobTable::Crashed::kYes));
}

/// After a pause, from its last checkpoint. It keeps its turn: jobs behind it would meet the same
/// full disk.
void JobRunner::try_again_with_room(const StoredJob& job, const std::string& why,
                                    const std::stop_token& stop) {
  const std::string words = folders_.without_places(why);
  const int times = live_.count_full_disk(job);
  if (times > kMostTimesFull) {
    // First of all: the end of a job takes room in the store as well. What the end says stays.
    clear_folder(folders_.of(job.id).work());
    clear_folder(folders_.of(job.id).map());
    return fail(job, fmt::format("{}, {} times", words, times));
  }
  spdlog::warn("job {} waits for room on the disk: {}", job.id, words);
  live_.note_progress(job, {.stage = "wait for room on the disk"});
  auto pause = setup_.first_pause_when_full;
  for (int i = 1; i < times; ++i) pause *= kLongerWhenFull;
  const auto go_on = std::chrono::steady_clock::now() + pause;
  while (std::chrono::steady_clock::now() < go_on && !stop.stop_requested() && !is_canceled(job)) {
    std::unique_lock lock(mutex_);
    changed_.wait_until(lock, stop,
                        std::min(go_on, std::chrono::steady_clock::now() + kLookAtStore),
                        [] { return false; });
  }
  live_.end(setup_.store.jobs().put_back(job, words, unix_ns()));
}

}  // namespace stillmap::server
