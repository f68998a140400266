#pragma once

#include "jobs/job_events.hpp"
#include "jobs/job_folders.hpp"
#include "jobs/job_progress.hpp"
#include "jobs/job_setup.hpp"
#include "jobs/job_uploads.hpp"

#include <condition_variable>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

namespace stillmap::server {

/// A job as clients see it.
struct JobView {
  StoredJob job;
  /// While it is processing.
  std::optional<JobProgress> progress{};
  /// JSON, of one that succeeded: `JobOutcome`. Empty when it is not known any more.
  std::string outcome{};
  /// Whether this server works on it, or may: then it makes its events.
  bool is_here = false;
};

/// What is known of jobs beside their rows in the store: how far they are, whether they are to be
/// cancelled, and the events of those that have not ended. Safe from several threads.
class LiveJobs {
 public:
  /// All of it outlives this.
  LiveJobs(const JobSetup& setup, const JobFolders& folders, JobUploads& uploads)
      : setup_(setup), folders_(folders), uploads_(uploads) {}

  /// @throws StoreRefusal kUnknownJob.
  [[nodiscard]] JobView view(std::int64_t id) const;
  [[nodiscard]] JobView view(const StoredJob& job) const;
  /// Nothing for one that has ended.
  [[nodiscard]] std::shared_ptr<JobEvents> events(std::int64_t id);
  /// @throws StoreRefusal kUnknownJob; kJobFinished, also as soon as its version is published.
  StoredJob cancel(std::int64_t id);

  // The rest is called by who runs them.

  /// An attempt begins. One at the same job that was lost and is under way still is to end, and is
  /// waited for: both would work in one folder. @return false when `stop` came first.
  bool begin(const StoredJob& job, const std::stop_token& stop);
  void note_progress(const StoredJob& job, const JobProgress& progress);
  /// As far as this server knows, without a look into the store.
  [[nodiscard]] bool wants_cancel(const JobClaim& claim) const;
  /// Somebody has asked for it, perhaps at another server.
  void note_cancel(std::int64_t id);
  /// How many attempts have met a full disk, with this one; the same however often it is asked.
  int count_full_disk(const StoredJob& job);
  /// An attempt has ended, and the store knows. One that ended for good is counted, its last event
  /// sent, and its work cleared.
  void end(const StoredJob& job);
  /// The attempts under way here, and how far they are.
  [[nodiscard]] std::map<JobClaim, JobAdvance> under_way() const;
  /// The job was given to another attempt: this one is to end.
  void lose(const JobClaim& claim);
  /// An attempt that was lost has ended.
  void forget(const JobClaim& claim);
  /// Ends the events of all.
  void close();

 private:
  /// Under way here.
  struct Attempt {
    JobProgress progress{};
    /// It is to end.
    bool cancel = false;
  };
  struct Live {
    /// How often it has met a full disk, and at which attempt last.
    int times_full = 0;
    std::int64_t full_at_attempt = 0;
    std::shared_ptr<JobEvents> events = std::make_shared<JobEvents>();
  };
  /// Of this job, in order; with `mutex_` held.
  [[nodiscard]] std::pair<std::map<JobClaim, Attempt>::iterator,
                          std::map<JobClaim, Attempt>::iterator>
  attempts_at(std::int64_t id);
  /// Tells of an end, or that the job waits again.
  void tell_end(const StoredJob& job);

  const JobSetup& setup_;
  const JobFolders& folders_;
  JobUploads& uploads_;
  mutable std::mutex mutex_;
  std::condition_variable_any attempt_ended_;
  std::map<JobClaim, Attempt> attempts_;
  std::map<std::int64_t, Live> live_;
};

/// One line: status, stage, progress, eta_s, error.
[[nodiscard]] std::string job_event_json(const JobView& view);

}  // namespace stillmap::server
