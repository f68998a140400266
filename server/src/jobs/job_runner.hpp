#pragma once

#include "jobs/job_attempt.hpp"
#include "jobs/job_folders.hpp"
#include "jobs/job_publisher.hpp"
#include "jobs/job_setup.hpp"
#include "jobs/job_uploads.hpp"
#include "jobs/live_jobs.hpp"
#include "jobs/room_check.hpp"

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <map>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

namespace stillmap::server {

/// Takes the store's jobs one after the other, or several at a time, and has the mapper do them, in
/// a process for each. Of the servers on one folder of a store a single one does; servers that
/// share a state each take jobs, and take over those of one that has gone silent. An attempt ends
/// with a map, which is published; or the job fails, is cancelled, or is put back to be tried
/// again.
class JobRunner {
 public:
  /// All of it outlives this.
  JobRunner(const JobSetup& setup, const JobFolders& folders, JobUploads& uploads, LiveJobs& live);
  /// Ends what runs, within `kEndGrace` and some; it goes on at the next start.
  ~JobRunner();
  JobRunner(const JobRunner&) = delete;
  JobRunner& operator=(const JobRunner&) = delete;

  /// There may be work.
  void wake();

 private:
  void work(const std::stop_token& stop);
  bool take_over();
  void watch(const std::stop_token& stop);
  void look_for_cancels();
  void say_what_is_ours();
  void take_over_silent();
  void run(const StoredJob& job, const std::stop_token& stop);
  [[nodiscard]] AttemptEnd attempt(const StoredJob& job, const std::stop_token& stop);
  /// @param is_unwanted  then what it waits for is killed, which is an error.
  [[nodiscard]] std::vector<std::string> prepare(const StoredJob& job,
                                                 const std::function<bool()>& is_unwanted);
  void conclude(const StoredJob& job, const AttemptEnd& end, const std::stop_token& stop);
  void publish(const StoredJob& job, const std::stop_token& stop);
  void give_up_publishing(const StoredJob& job);
  void fail(const StoredJob& job, const std::string& why);
  void try_again(const StoredJob& job, const std::string& why);
  void try_again_with_room(const StoredJob& job, const std::string& why,
                           const std::stop_token& stop);
  [[nodiscard]] bool is_canceled(const StoredJob& job) const;

  const JobSetup& setup_;
  const JobFolders& folders_;
  JobUploads& uploads_;
  LiveJobs& live_;
  JobPublisher publisher_;
  RoomCheck room_;
  std::mutex take_over_mutex_;
  /// Of the store's folder of jobs, and of the one to work in; `take_over_mutex_` guards them.
  std::vector<Descriptor> locks_;
  /// By which the state knows this server, also after its restart; set with `locks_`.
  std::string server_;
  /// Names under which files of jobs are here; empty where all are. Set with `locks_`.
  std::vector<std::string> files_at_;
  /// What others do, and since when they have said nothing. For `watch` alone.
  std::map<JobTable::Beat, std::chrono::steady_clock::time_point> silent_since_;
  std::mutex mutex_;
  std::condition_variable_any changed_;
  /// Grows when there may be work.
  std::uint64_t wakes_ = 0;
  std::vector<std::jthread> threads_;  // last: they use all of the above
};

}  // namespace stillmap::server
