#include "jobs/job_runner.hpp"
#include "store/ids_and_times.hpp"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <sstream>
#include <system_error>

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

/// How often a job waits for room on a full disk: with the pauses, for half an hour, in which what
/// it has made so far takes room itself.
constexpr int kMostTimesFull = 5;
constexpr int kLongerWhenFull = 5;

/// How often a job's program, or the server while it published, crashed, with this attempt; the
/// same however often it is asked.
std::size_t count_crash(const JobFolder& folder, const StoredJob& job) {
  std::size_t crashes = 0;
  std::int64_t last_attempt = 0;
  std::istringstream(read_small_file(folder.crashes()).value_or("")) >> crashes >> last_attempt;
  if (last_attempt == job.attempts) return crashes;
  ++crashes;
  try {
    write_small_file(folder.crashes(), fmt::format("{} {}", crashes, job.attempts));
  } catch (const maps::StorageError& error) {
    spdlog::error("job {}: its crash could not be counted: {}", job.id, error.what());
  }
  return crashes;
}

}  // namespace

/// As often as the options allow; then it has failed.
void JobRunner::try_again(const StoredJob& job, const std::string& why) {
  const std::size_t crashes = count_crash(folder(job.id), job);
  std::error_code error;
  fs::remove(folder(job.id).publishing(), error);
  const std::string words = without_places(why);
  JobTable& jobs = setup_.store.jobs();
  if (crashes > static_cast<std::size_t>(setup_.live.current()->jobs.retries))
    return fail(job, fmt::format("{}, {} times", words, crashes));
  spdlog::warn("job {} is tried again: {}", job.id, words);
  ended(jobs.put_back(job.id, words, unix_ns()));
}

/// How many attempts have met a full disk, with this one; the same however often it is asked.
int JobRunner::count_full(const StoredJob& job) {
  const std::scoped_lock lock(mutex_);
  Active& active = active_[job.id];
  if (active.full_at_attempt != job.attempts) ++active.times_full;
  active.full_at_attempt = job.attempts;
  return active.times_full;
}

/// After a pause, from its last checkpoint. It keeps its turn: jobs behind it would meet the same
/// full disk.
void JobRunner::try_again_with_room(const StoredJob& job, const std::string& why,
                                    const std::stop_token& stop) {
  std::error_code error;
  fs::remove(folder(job.id).publishing(), error);
  const std::string words = without_places(why);
  JobTable& jobs = setup_.store.jobs();
  const int times = count_full(job);
  if (times > kMostTimesFull) {
    // First of all: the end of a job takes room in the store as well. What the end says stays.
    fs::remove_all(folder(job.id).work(), error);
    fs::remove_all(folder(job.id).map(), error);
    return fail(job, fmt::format("{}, {} times", words, times));
  }
  spdlog::warn("job {} waits for room on the disk: {}", job.id, words);
  note_progress(job, {.stage = "wait for room on the disk"});
  auto pause = setup_.first_pause_when_full;
  for (int i = 1; i < times; ++i) pause *= kLongerWhenFull;
  const auto go_on = std::chrono::steady_clock::now() + pause;
  std::unique_lock lock(mutex_, std::defer_lock);
  while (std::chrono::steady_clock::now() < go_on && !stop.stop_requested() && !is_canceled(job)) {
    lock.lock();
    changed_.wait_until(lock, stop,
                        std::min(go_on, std::chrono::steady_clock::now() + kLookAtStore),
                        [] { return false; });
    lock.unlock();
  }
  ended(jobs.put_back(job.id, words, unix_ns()));
}

}  // namespace stillmap::server
