#include "jobs/live_jobs.hpp"

#include "store/ids_and_times.hpp"

#include <spdlog/spdlog.h>

#include <exception>
#include <utility>

namespace stillmap::server {
namespace {

/// Runs what may throw where nobody could do anything about it.
template <typename Work>
void try_or_log(const char* what, std::int64_t id, Work&& work) {
  try {
    std::forward<Work>(work)();
  } catch (const std::exception& error) {
    spdlog::error("job {}: {}: {}", id, what, error.what());
  }
}

}  // namespace

JobView LiveJobs::view(std::int64_t id) const { return view(setup_.store.jobs().job(id)); }

JobView LiveJobs::view(const StoredJob& job) const {
  JobView view{.job = job};
  if (job.status == JobStatus::kProcessing) {
    const std::scoped_lock lock(mutex_);
    const auto found = live_.find(job.id);
    if (found != live_.end()) view.progress = found->second.progress;
  }
  if (job.status == JobStatus::kEnqueued && !folders_.has_files_of(job.files_at))
    view.job.stage = "waits for server " + job.files_at + ", which has its " +
                     (job.kind == JobKind::kConvert ? "file" : "drives");
  if (job.status == JobStatus::kSucceeded)
    view.outcome = read_small_file(folders_.of(job.id).outcome()).value_or("");
  return view;
}

std::shared_ptr<JobEvents> LiveJobs::events(std::int64_t id) {
  const std::scoped_lock lock(mutex_);
  // Under the lock: an end that is noted after this look finds the events that are made here.
  if (is_finished(setup_.store.jobs().job(id).status) && !live_.contains(id)) return nullptr;
  return live_[id].events;
}

StoredJob LiveJobs::cancel(std::int64_t id) {
  const std::int64_t now_ns = unix_ns();
  StoredJob job = setup_.store.jobs().request_cancel(id, now_ns);
  if (job.status == JobStatus::kCanceled) {
    // Else it had ended before, and was told of and counted then.
    if (job.finished_ns == now_ns) end(job);
    return job;
  }
  // None, when it has ended meanwhile: an entry made here would stay, and its events never end. One
  // that is about to begin looks at the store.
  const std::scoped_lock lock(mutex_);
  if (const auto found = live_.find(id); found != live_.end()) found->second.cancel = true;
  return job;
}

void LiveJobs::begin(const StoredJob& job) {
  {
    const std::scoped_lock lock(mutex_);
    live_[job.id].progress = {};
    live_[job.id].claim = job;
  }
  note_progress(job, {.stage = "prepare"});
}

void LiveJobs::note_progress(const StoredJob& job, const JobProgress& progress) {
  std::shared_ptr<JobEvents> events;
  bool is_new_stage = false;
  {
    const std::scoped_lock lock(mutex_);
    Live& live = live_[job.id];
    is_new_stage = live.progress.stage != progress.stage;
    live.progress = progress;
    events = live.events;
  }
  JobView view{.job = job, .progress = progress};
  view.job.stage = progress.stage;
  events->add("progress", job_event_json(view), unix_ns());
  if (!is_new_stage) return;
  try_or_log("its stage could not be kept", job.id,
             [&] { setup_.store.jobs().set_stage(job, progress.stage); });
  try_or_log("whether it was cancelled is not known", job.id, [&] {
    // By another process, or before the restart.
    if (!setup_.store.jobs().job(job.id).cancel_requested) return;
    const std::scoped_lock lock(mutex_);
    live_[job.id].cancel = true;
  });
}

bool LiveJobs::wants_cancel(std::int64_t id) const {
  const std::scoped_lock lock(mutex_);
  const auto found = live_.find(id);
  return found != live_.end() && found->second.cancel;
}

bool LiveJobs::is_lost(std::int64_t id) const {
  const std::scoped_lock lock(mutex_);
  const auto found = live_.find(id);
  return found != live_.end() && found->second.lost;
}

int LiveJobs::count_full_disk(const StoredJob& job) {
  const std::scoped_lock lock(mutex_);
  Live& live = live_[job.id];
  if (live.full_at_attempt != job.attempts) ++live.times_full;
  live.full_at_attempt = job.attempts;
  return live.times_full;
}

void LiveJobs::end(const StoredJob& job) {
  const bool finished = is_finished(job.status);
  std::shared_ptr<JobEvents> events;
  {
    const std::scoped_lock lock(mutex_);
    events = live_[job.id].events;
    live_[job.id].progress = {};
    live_[job.id].claim.reset();
    if (finished) live_.erase(job.id);
  }
  events->add(finished ? "end" : "progress", job_event_json(view(job)), unix_ns());
  if (!finished) return;
  events->close();
  spdlog::info("job {} has {}{}{}", job.id, name_of(job.status), job.error.empty() ? "" : ": ",
               job.error);
  const double seconds =
      1e-9 * static_cast<double>(*job.finished_ns - job.started_ns.value_or(*job.finished_ns));
  setup_.metrics.job_ended(name_of(job.status), seconds);
  clear_folder(folders_.of(job.id).scratch());
  try_or_log("its upload was not cleared", job.id, [&] { uploads_.clear_unused(); });
}

void LiveJobs::forget(std::int64_t id) {
  const std::scoped_lock lock(mutex_);
  const auto found = live_.find(id);
  if (found == live_.end()) return;
  found->second.events->close();
  live_.erase(found);
}

std::vector<JobClaim> LiveJobs::claims() const {
  const std::scoped_lock lock(mutex_);
  std::vector<JobClaim> claims;
  for (const auto& [id, live] : live_)
    if (live.claim) claims.push_back(*live.claim);
  return claims;
}

void LiveJobs::lose(const JobClaim& claim) {
  const std::scoped_lock lock(mutex_);
  const auto found = live_.find(claim.id);
  if (found == live_.end() || found->second.claim != claim) return;
  found->second.cancel = true;
  found->second.lost = true;
}

std::vector<std::int64_t> LiveJobs::ids() const {
  const std::scoped_lock lock(mutex_);
  std::vector<std::int64_t> ids;
  for (const auto& [id, live] : live_) ids.push_back(id);
  return ids;
}

void LiveJobs::close() {
  const std::scoped_lock lock(mutex_);
  for (auto& [id, live] : live_) live.events->close();
}

}  // namespace stillmap::server
