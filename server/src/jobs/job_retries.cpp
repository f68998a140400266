#include "ids_and_times.hpp"
#include "jobs/job_runner.hpp"

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

/// How soon a cancel is seen that another process wrote into the store.
constexpr std::chrono::seconds kLookAtStore{1};
/// How often a job waits for room on a full disk: with the pauses, for some 25 hours.
constexpr int kMostTimesFull = 30;
constexpr std::chrono::hours kMostPauseWhenFull{1};

/// How often a job's program, or the server while it published, crashed, with this attempt; the
/// same however often it is asked.
std::size_t count_crash(const JobFolder& folder, const maps::StoredJob& job) {
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
void JobRunner::try_again(const maps::StoredJob& job, const std::string& why) {
  const std::size_t crashes = count_crash(folder(job.id), job);
  std::error_code error;
  fs::remove(folder(job.id).publishing(), error);
  const std::string words = without_places(why);
  maps::JobTable& jobs = setup_.store.jobs();
  if (crashes > static_cast<std::size_t>(setup_.live.current()->jobs.retries))
    return fail(job, fmt::format("{}, {} times", words, crashes));
  spdlog::warn("job {} is tried again: {}", job.id, words);
  ended(jobs.put_back(job.id, words, unix_ns()));
}

/// After a pause, from its last checkpoint. It keeps its turn: jobs behind it would meet the same
/// full disk.
void JobRunner::try_again_with_room(const maps::StoredJob& job, const std::string& why,
                                    const std::stop_token& stop) {
  std::error_code error;
  fs::remove(folder(job.id).publishing(), error);
  const std::string words = without_places(why);
  maps::JobTable& jobs = setup_.store.jobs();
  std::unique_lock lock(mutex_);
  const int times = ++active_[job.id].times_full;
  lock.unlock();
  if (times > kMostTimesFull) return fail(job, fmt::format("{}, {} times", words, times));
  spdlog::warn("job {} waits for room on the disk: {}", job.id, words);
  note_progress(job, {.stage = "wait for room on the disk"});
  const auto pause = std::min<std::chrono::milliseconds>(
      kMostPauseWhenFull, setup_.first_pause_when_full * (1LL << std::min(times - 1, 20)));
  const auto go_on = std::chrono::steady_clock::now() + pause;
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
