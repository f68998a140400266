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
    view.progress = JobProgress{
        .stage = job.stage, .fraction = job.advance.fraction, .eta_s = job.advance.eta_s};
    const std::scoped_lock lock(mutex_);
    const auto found = attempts_.find(job);
    view.is_here = found != attempts_.end();
    if (view.is_here) view.progress = found->second.progress;
  }
  if (job.status == JobStatus::kEnqueued) view.is_here = folders_.has_files_of(job.files_at);
  if (job.status == JobStatus::kEnqueued && !view.is_here)
    view.job.stage = "waits for server " + job.files_at + ", which has its " +
                     (job.kind == JobKind::kConvert ? "file" : "drives");
  if (job.status == JobStatus::kSucceeded) {
    view.outcome = job.outcome;
    // An older program kept it in a file.
    if (view.outcome.empty())
      view.outcome = read_small_file(folders_.of(job.id).outcome()).value_or("");
  }
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
  note_cancel(id);
  // One that runs goes on until it notices. The end of one that had ended before was told then.
  if (job.status == JobStatus::kCanceled && job.finished_ns == now_ns) tell_end(job);
  return job;
}

std::pair<std::map<JobClaim, LiveJobs::Attempt>::iterator,
          std::map<JobClaim, LiveJobs::Attempt>::iterator>
LiveJobs::attempts_at(std::int64_t id) {
  const auto at = [&](std::int64_t job) {
    return attempts_.lower_bound(StoredJob{.id = job, .attempts = 0});
  };
  return {at(id), at(id + 1)};
}

bool LiveJobs::begin(const StoredJob& job, const std::stop_token& stop) {
  {
    std::unique_lock lock(mutex_);
    attempts_[job] = {};
    const auto is_oldest = [&] { return attempts_at(job.id).first->first == JobClaim(job); };
    for (auto [each, end] = attempts_at(job.id); each != end && each->first != JobClaim(job);
         ++each)
      each->second.cancel = true;
    if (!attempt_ended_.wait(lock, stop, is_oldest)) return false;
  }
  note_progress(job, {.stage = "prepare"});
  return true;
}

void LiveJobs::note_progress(const StoredJob& job, const JobProgress& progress) {
  std::shared_ptr<JobEvents> events;
  bool is_new_stage = false;
  {
    const std::scoped_lock lock(mutex_);
    JobProgress& known = attempts_[job].progress;
    is_new_stage = known.stage != progress.stage;
    known = progress;
    events = live_[job.id].events;
  }
  JobView view{.job = job, .progress = progress};
  view.job.stage = progress.stage;
  events->add("progress", job_event_json(view), unix_ns());
  if (!is_new_stage) return;
  try_or_log("its stage could not be kept", job.id,
             [&] { setup_.store.jobs().set_stage(job, progress.stage); });
}

bool LiveJobs::wants_cancel(const JobClaim& claim) const {
  const std::scoped_lock lock(mutex_);
  const auto found = attempts_.find(claim);
  return found != attempts_.end() && found->second.cancel;
}

void LiveJobs::note_cancel(std::int64_t id) {
  const std::scoped_lock lock(mutex_);
  for (auto [each, end] = attempts_at(id); each != end; ++each) each->second.cancel = true;
}

int LiveJobs::count_full_disk(const StoredJob& job) {
  const std::scoped_lock lock(mutex_);
  Live& live = live_[job.id];
  if (live.full_at_attempt != job.attempts) ++live.times_full;
  live.full_at_attempt = job.attempts;
  return live.times_full;
}

void LiveJobs::end(const StoredJob& job) {
  {
    const std::scoped_lock lock(mutex_);
    attempts_.erase(job);
    attempt_ended_.notify_all();
  }
  tell_end(job);
}

void LiveJobs::tell_end(const StoredJob& job) {
  const bool finished = is_finished(job.status);
  std::shared_ptr<JobEvents> events;
  bool is_left = true;
  {
    const std::scoped_lock lock(mutex_);
    events = live_[job.id].events;
    if (finished) live_.erase(job.id);
    const auto [first, end] = attempts_at(job.id);
    is_left = first == end;
  }
  events->add(finished ? "end" : "progress", job_event_json(view(job)), unix_ns());
  if (!finished) return;
  events->close();
  spdlog::info("job {} has {}{}{}", job.id, name_of(job.status), job.error.empty() ? "" : ": ",
               job.error);
  const double seconds =
      1e-9 * static_cast<double>(*job.finished_ns - job.started_ns.value_or(*job.finished_ns));
  setup_.metrics.job_ended(name_of(job.status), seconds);
  // Else an attempt that was lost works in it still; housekeeping clears it.
  if (is_left) folders_.clear_work(folders_.of(job.id));
  try_or_log("its upload was not cleared", job.id, [&] { uploads_.clear_unused(); });
}

std::map<JobClaim, JobAdvance> LiveJobs::under_way() const {
  const std::scoped_lock lock(mutex_);
  std::map<JobClaim, JobAdvance> under_way;
  for (const auto& [claim, attempt] : attempts_)
    under_way[claim] = {attempt.progress.fraction, attempt.progress.eta_s};
  return under_way;
}

void LiveJobs::lose(const JobClaim& claim) {
  const std::scoped_lock lock(mutex_);
  const auto found = attempts_.find(claim);
  if (found != attempts_.end()) found->second.cancel = true;
}

void LiveJobs::forget(const JobClaim& claim) {
  const std::scoped_lock lock(mutex_);
  attempts_.erase(claim);
  attempt_ended_.notify_all();
  // Another one may be under way here, and goes on with the events.
  const auto [first, end] = attempts_at(claim.id);
  const auto found = live_.find(claim.id);
  if (first != end || found == live_.end()) return;
  found->second.events->close();
  live_.erase(found);
}

void LiveJobs::close() {
  const std::scoped_lock lock(mutex_);
  for (auto& [id, live] : live_) live.events->close();
}

}  // namespace stillmap::server
