#pragma once

#include "jobs/job_events.hpp"
#include "jobs/job_folders.hpp"
#include "jobs/job_progress.hpp"
#include "jobs/job_setup.hpp"
#include "jobs/job_uploads.hpp"

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::server {

/// A job as clients see it.
struct JobView {
  StoredJob job;
  /// While it is processing.
  std::optional<JobProgress> progress{};
  /// JSON, of one that succeeded: `JobOutcome`. Empty when it is not known any more.
  std::string outcome{};
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

  /// An attempt begins.
  void begin(const StoredJob& job);
  void note_progress(const StoredJob& job, const JobProgress& progress);
  /// As far as this server knows, without a look into the store.
  [[nodiscard]] bool wants_cancel(std::int64_t id) const;
  /// Whether another server has taken it over.
  [[nodiscard]] bool is_lost(std::int64_t id) const;
  /// How many attempts have met a full disk, with this one; the same however often it is asked.
  int count_full_disk(const StoredJob& job);
  /// An attempt has ended, and the store knows. One that ended for good is counted, its last event
  /// sent, and its work cleared.
  void end(const StoredJob& job);
  /// The attempts under way here.
  [[nodiscard]] std::vector<JobClaim> claims() const;
  /// Another server has taken the job over: what is under way here is to end.
  void lose(const JobClaim& claim);
  /// A job is not ours any more.
  void forget(std::int64_t id);
  /// Of those that have not ended, or whose events somebody reads.
  [[nodiscard]] std::vector<std::int64_t> ids() const;
  /// Ends the events of all.
  void close();

 private:
  struct Live {
    JobProgress progress;
    bool cancel = false;
    bool lost = false;
    /// While an attempt is under way here.
    std::optional<JobClaim> claim{};
    /// How often it has met a full disk, and at which attempt last.
    int times_full = 0;
    std::int64_t full_at_attempt = 0;
    std::shared_ptr<JobEvents> events = std::make_shared<JobEvents>();
  };

  const JobSetup& setup_;
  const JobFolders& folders_;
  JobUploads& uploads_;
  mutable std::mutex mutex_;
  std::map<std::int64_t, Live> live_;
};

/// One line: status, stage, progress, eta_s, error.
[[nodiscard]] std::string job_event_json(const JobView& view);

}  // namespace stillmap::server
