#include "jobs/job_runner.hpp"

#include "errors/api_error.hpp"
#include "errors/refusal_codes.hpp"
#include "errors/upload_errors.hpp"
#include "jobs/program_crash.hpp"
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
#include <stdexcept>
#include <system_error>
#include <utility>

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

/// In the store.
constexpr const char* kJobs = "jobs";
/// How soon the jobs of another server are taken over when it is gone.
constexpr std::chrono::seconds kLookAtLock{2};
/// How soon the end of a job that could not be kept is tried again, at most.
constexpr std::chrono::seconds kMostBetweenTries{30};

/// Runs what may throw where nobody could do anything about it.
template <typename Work>
void quietly(const char* what, std::int64_t id, Work&& work) {
  try {
    std::forward<Work>(work)();
  } catch (const std::exception& error) {
    spdlog::error("job {}: {}: {}", id, what, error.what());
  }
}

fs::path job_root(const JobOptions& options, const PackageStore& store) {
  return options.work_dir.empty() ? store.folder() / kJobs : fs::path(options.work_dir);
}

/// Whether the server that had the job before ended so. Counted as a crash, else a map that is too
/// large for the memory would end every server that follows.
bool ended_publishing(const JobFolder& folder) {
  std::error_code error;
  return fs::exists(folder.publishing(), error);
}

}  // namespace

JobRunner::JobRunner(const Setup& setup)
    : setup_(setup), root_(job_root(setup.live.current()->jobs, setup.store)) {
  if (!setup_.store.read_only_because().empty()) return;
  if (setup_.mapper.empty()) spdlog::warn("stillmap-mapper is not there: jobs will fail");
  for (int i = 0; i < setup_.live.current()->jobs.concurrent; ++i)
    threads_.emplace_back([this](const std::stop_token& stop) { work(stop); });
}

JobRunner::~JobRunner() {
  for (std::jthread& thread : threads_) thread.request_stop();
  {
    // Who does not wait for a map that is being loaded has not crashed.
    const std::scoped_lock lock(take_over_mutex_, mutex_);
    std::error_code error;
    // Of another server's jobs events alone are known here.
    const bool are_ours = !locks_.empty();
    for (const auto& [id, active] : active_)
      if (are_ours) fs::remove(folder(id).publishing(), error);
  }
  wake();
  threads_.clear();
  const std::scoped_lock lock(mutex_);
  for (auto& [id, active] : active_) active.events->close();
}

JobFolder JobRunner::folder(std::int64_t id) const { return {root_ / std::to_string(id)}; }

ProcessLimits JobRunner::limits() const {
  const JobOptions jobs = setup_.live.current()->jobs;
  return {.nice = jobs.nice, .cores = jobs.cores, .memory_bytes = jobs.memory_bytes};
}

std::string JobRunner::without_places(std::string text) const {
  // `root_` may lie elsewhere, but holds what "jobs" of the store does.
  const fs::path store = setup_.store.folder();
  const std::string root = root_.string() + "/";
  const std::string usual = (store / "jobs/").string();
  for (std::size_t at = text.find(root); root != usual && at != std::string::npos;
       at = text.find(root, at + usual.size()))
    text.replace(at, root.size(), usual);
  return without_folder(std::move(text), store);
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
      } else if (const auto job = setup_.store.jobs().claim(unix_ns())) {
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
  const fs::path of_store = setup_.store.folder() / kJobs;
  fs::create_directories(of_store);
  fs::create_directories(root_);
  std::vector<fs::path> folders = {of_store};
  if (!fs::equivalent(of_store, root_)) folders.push_back(root_);
  std::vector<Descriptor> held;
  for (const fs::path& folder : folders) {
    Descriptor file(::open((folder / ".lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0640));
    if (!file.is_open() || ::flock(file.get(), LOCK_EX | LOCK_NB) != 0) return false;
    held.push_back(std::move(file));
  }
  const std::size_t back =
      setup_.store.jobs().put_back_all("the server ended meanwhile", unix_ns());
  if (back > 0) spdlog::info("{} jobs go on that were interrupted", back);
  // Whoever held the lock before is gone, and what it was receiving with it.
  clear_uploads(true);
  clear_forgotten();
  locks_ = std::move(held);
  return true;
}

void JobRunner::run(const StoredJob& job, const std::stop_token& stop) {
  spdlog::info("job {} begins: {} of {}, attempt {}", job.id, name_of(job.kind), job.map,
               job.attempts);
  {
    const std::scoped_lock lock(mutex_);
    active_[job.id].progress = {};
  }
  note_progress(job, {.stage = "prepare"});
  const AttemptEnd end =
      ended_publishing(folder(job.id))
          ? AttemptEnd{AttemptEnd::Kind::kCrashed, "the server ended while it published the map"}
          : attempt(job, stop);
  // What the store cannot keep just now, as on a full disk, is tried until the server ends; at its
  // next start the job is put back.
  std::chrono::seconds pause = kLookAtStore;
  do {
    try {
      return settle(job, end, stop);
    } catch (const StoreRefusal& refusal) {
      // Somebody else has ended or forgotten it.
      spdlog::error("job {}: {}", job.id, refusal.what());
      return let_go(job.id);
    } catch (const std::exception& error) {
      spdlog::error("job {}: its end could not be kept: {}", job.id, error.what());
    }
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, stop, pause, [] { return false; });
    pause = std::min(2 * pause, kMostBetweenTries);
  } while (!stop.stop_requested());
}

AttemptEnd JobRunner::attempt(const StoredJob& job, const std::stop_token& stop) {
  JobAttempt attempt{
      .command = {},
      .limits = limits(),
      .log = folder(job.id).log(),
      .most = std::chrono::seconds(setup_.live.current()->jobs.time_limit_s),
      .is_canceled = [&] { return wants_cancel(job.id); },
      .is_stopping = [&] { return stop.stop_requested(); },
      .on_progress = [&](const JobProgress& progress) { note_progress(job, progress); }};
  using Kind = AttemptEnd::Kind;
  AttemptEnd unprepared;
  try {
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
  const JobFolder folder = this->folder(job.id);
  fs::create_directories(folder.scratch());
  sync_folder(root_);
  if (setup_.mapper.empty()) throw std::runtime_error("stillmap-mapper is not there");
  const int threads = setup_.live.current()->jobs.cores;
  if (job.kind == JobKind::kConvert) {
    // It has no checkpoints: half a map would be in the way.
    clear_folder(folder.map());
    const ConvertRequest request = read_convert_request(job.request);
    const fs::path file = folder.scratch() / ("map." + request.format);
    std::error_code error;
    fs::remove(file, error);
    fs::create_hard_link(upload(request.sha256), file);
    return convert_command(setup_.mapper, file, folder, threads);
  }
  const RebuildRequest request = read_stored_rebuild(job.request);
  const RebuildSources sources = sources_of(job, request);
  // A second attempt has used some of it.
  if (job.attempts == 1) {
    check_room(job.map, request, sources,
               std::chrono::seconds(setup_.live.current()->jobs.time_limit_s), is_unwanted);
  }
  write_small_file(folder.gate(), gate_json(setup_.live.current()->gate));
  if (!request.edits.empty()) write_small_file(folder.edits(), request.edits);
  return rebuild_command(setup_.mapper, request, sources, folder, threads);
}

bool JobRunner::wants_cancel(std::int64_t id) {
  const std::scoped_lock lock(mutex_);
  const auto found = active_.find(id);
  return found != active_.end() && found->second.cancel;
}

/// By whomever: another process may have written so into the store.
bool JobRunner::is_canceled(const StoredJob& job) const {
  return setup_.store.jobs().job(job.id).cancel_requested;
}

void JobRunner::note_progress(const StoredJob& job, const JobProgress& progress) {
  std::shared_ptr<JobEvents> events;
  bool is_new_stage = false;
  {
    const std::scoped_lock lock(mutex_);
    Active& active = active_[job.id];
    is_new_stage = active.progress.stage != progress.stage;
    active.progress = progress;
    events = active.events;
  }
  JobView view{.job = job, .progress = progress};
  view.job.stage = progress.stage;
  events->add("progress", job_event_json(view), unix_ns());
  if (!is_new_stage) return;
  quietly("its stage could not be kept", job.id,
          [&] { setup_.store.jobs().set_stage(job.id, progress.stage); });
  quietly("whether it was cancelled is not known", job.id, [&] {
    // By another process, or before the restart.
    if (!setup_.store.jobs().job(job.id).cancel_requested) return;
    const std::scoped_lock lock(mutex_);
    active_[job.id].cancel = true;
  });
}

void JobRunner::settle(const StoredJob& job, const AttemptEnd& end, const std::stop_token& stop) {
  using Kind = AttemptEnd::Kind;
  JobTable& jobs = setup_.store.jobs();
  switch (end.kind) {
    case Kind::kDone:
      if (wants_cancel(job.id)) return ended(jobs.end_canceled(job.id, unix_ns()));
      return publish(job, stop);
    case Kind::kFailed:
    case Kind::kTimedOut:
      return fail(job, without_places(end.why));
    case Kind::kCanceled:
      return ended(jobs.end_canceled(job.id, unix_ns()));
    case Kind::kStopped:
      return ended(jobs.put_back(job.id, end.why, unix_ns()));
    case Kind::kCrashed:
      return try_again(job, end.why);
    case Kind::kDiskFull:
      return try_again_with_room(job, end.why, stop);
  }
}

/// Nothing is known here any more of a job that is not ours.
void JobRunner::let_go(std::int64_t id) {
  const std::scoped_lock lock(mutex_);
  const auto found = active_.find(id);
  if (found == active_.end()) return;
  found->second.events->close();
  active_.erase(found);
}

/// After the store was told: nothing is left to do when it has ended for good.
void JobRunner::ended(const StoredJob& job) {
  const bool finished = is_finished(job.status);
  std::shared_ptr<JobEvents> events;
  {
    const std::scoped_lock lock(mutex_);
    events = active_[job.id].events;
    active_[job.id].progress = {};
    if (finished) active_.erase(job.id);
  }
  events->add(finished ? "end" : "progress", job_event_json(view(job)), unix_ns());
  if (!finished) return;
  events->close();
  spdlog::info("job {} has {}{}{}", job.id, name_of(job.status), job.error.empty() ? "" : ": ",
               job.error);
  const double seconds =
      1e-9 * static_cast<double>(*job.finished_ns - job.started_ns.value_or(*job.finished_ns));
  setup_.metrics.job_ended(name_of(job.status), seconds);
  clear_folder(folder(job.id).scratch());
  quietly("its upload was not cleared", job.id, [&] { clear_uploads(false); });
}

StoredJob JobRunner::cancel(std::int64_t id) {
  const std::int64_t now_ns = unix_ns();
  StoredJob job = setup_.store.jobs().request_cancel(id, now_ns);
  if (job.status == JobStatus::kCanceled) {
    // Else it had ended before, and was told of and counted then.
    if (job.finished_ns == now_ns) ended(job);
    return job;
  }
  // None, when it has ended meanwhile: an entry made here would stay, and its events never end. One
  // that is about to begin looks at the store.
  const std::scoped_lock lock(mutex_);
  if (const auto found = active_.find(id); found != active_.end()) found->second.cancel = true;
  return job;
}

JobView JobRunner::view(std::int64_t id) const { return view(setup_.store.jobs().job(id)); }

JobView JobRunner::view(const StoredJob& job) const {
  JobView view{.job = job};
  if (job.status == JobStatus::kProcessing) {
    const std::scoped_lock lock(mutex_);
    const auto found = active_.find(job.id);
    if (found != active_.end()) view.progress = found->second.progress;
  }
  if (job.status == JobStatus::kSucceeded)
    view.outcome = read_small_file(folder(job.id).outcome()).value_or("");
  return view;
}

std::shared_ptr<JobEvents> JobRunner::events(std::int64_t id) {
  const std::scoped_lock lock(mutex_);
  // Under the lock: an end that is noted after this look finds the events that are made here.
  if (is_finished(setup_.store.jobs().job(id).status) && !active_.contains(id)) return nullptr;
  return active_[id].events;
}

void JobRunner::clear_forgotten() {
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(root_, error)) {
    const std::optional<std::int64_t> id = id_in(entry.path().filename().string());
    if (!id) continue;
    try {
      const StoredJob job = setup_.store.jobs().job(*id);
      if (is_finished(job.status)) clear_folder(folder(*id).scratch());
    } catch (const StoreRefusal&) {
      clear_folder(entry.path());
    }
  }
}

}  // namespace stillmap::server
