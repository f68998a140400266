#pragma once

#include "catalog/map_catalog.hpp"
#include "jobs/job_attempt.hpp"
#include "jobs/job_events.hpp"
#include "jobs/job_folder.hpp"
#include "jobs/job_outcome.hpp"
#include "jobs/job_request.hpp"
#include "jobs/mapper_command.hpp"
#include "metrics/metrics.hpp"

#include <stillmap/server/options_holder.hpp>
#include "store/drive_store.hpp"
#include "store/package_store.hpp"

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <vector>

namespace stillmap::server {

/// How soon a job is seen, or its cancel, that another process wrote into the store.
inline constexpr std::chrono::seconds kLookAtStore{1};

/// A job as clients see it.
struct JobView {
  StoredJob job;
  /// While it is processing.
  std::optional<JobProgress> progress{};
  /// JSON, of one that succeeded: `JobOutcome`. Empty when it is not known any more.
  std::string outcome{};
};

/// Takes the store's jobs one after the other, or several at a time, and has the mapper do them, in
/// a process for each (server/operation.md, "Jobs"). Of the servers on one store a single one does.
/// Safe from several threads.
class JobRunner {
 public:
  /// What it works with; all of it outlives this.
  struct Setup {
    const OptionsHolder& live;
    PackageStore& store;
    DriveStore& drives;
    MapCatalog& catalog;
    Metrics& metrics;
    /// Program; empty when there is none: jobs then fail in words.
    std::filesystem::path mapper;
    /// How long a job first waits for room on a full disk; then five times as long each time.
    /// Short at first: what filled the disk may have been a file that is gone again.
    std::chrono::milliseconds first_pause_when_full = std::chrono::seconds(2);
  };
  explicit JobRunner(const Setup& setup);
  /// Ends what runs, within `kEndGrace` and some; it goes on at the next start.
  ~JobRunner();
  JobRunner(const JobRunner&) = delete;
  JobRunner& operator=(const JobRunner&) = delete;

  /// Who asks, and under which name of their own.
  struct Asker {
    std::string key_id;
    std::optional<std::string> idempotency_key;
  };
  /// @throws ApiError kDiskFull, kBusy when too many wait, kInvalidRequest for what the mapper
  /// would refuse, kOtherDigest when the version is there, was removed, or another job makes it;
  /// StoreRefusal as `JobTable::enqueue`, and kOverQuota.
  JobTable::Enqueued rebuild(const std::string& map, const RebuildRequest& request,
                             const Asker& asker);
  /// Of a file that `receive` took. @return the one that is under way for it, or has made this
  /// version of it, when there is one.
  /// @throws ApiError kOtherDigest when the version is there or another file is on its way to it;
  /// StoreRefusal kOverQuota.
  JobTable::Enqueued convert(const std::string& map, const ConvertRequest& request,
                             const Asker& asker);
  /// The newest job that was to convert a file to this version, however it ended.
  [[nodiscard]] std::optional<StoredJob> newest_conversion(const std::string& map,
                                                           const std::string& version) const;
  /// Whether so many bytes of a map file may come beside those that wait for their jobs.
  /// @throws StoreRefusal kOverQuota.
  void check_upload_quota(const std::string& map, std::uint64_t bytes) const;
  /// Keeps the bytes of a map file for a job to come. @return their SHA-256.
  /// @throws InputError when they are others than was said; StorageError.
  std::string receive(const ByteSource& source, std::uint64_t bytes,
                      const std::optional<std::string>& sha256, const std::string& name);
  /// @throws StoreRefusal kUnknownJob; kJobFinished, also as soon as its version is published.
  StoredJob cancel(std::int64_t id);

  /// @throws StoreRefusal kUnknownJob.
  [[nodiscard]] JobView view(std::int64_t id) const;
  [[nodiscard]] JobView view(const StoredJob& job) const;
  /// Nothing for one that has ended.
  [[nodiscard]] std::shared_ptr<JobEvents> events(std::int64_t id);
  [[nodiscard]] JobFolder folder(std::int64_t id) const;
  /// Removes the folders of jobs that the store does not know any more.
  void clear_forgotten();

 private:
  /// What is known of a job that has not ended.
  struct Active {
    JobProgress progress;
    bool cancel = false;
    /// How often it has met a full disk, and at which attempt last.
    int times_full = 0;
    std::int64_t full_at_attempt = 0;
    std::shared_ptr<JobEvents> events = std::make_shared<JobEvents>();
  };

  void work(const std::stop_token& stop);
  bool take_over();
  void run(const StoredJob& job, const std::stop_token& stop);
  [[nodiscard]] AttemptEnd attempt(const StoredJob& job, const std::stop_token& stop);
  /// @param is_unwanted  then what it waits for is killed, which is an error.
  [[nodiscard]] std::vector<std::string> prepare(const StoredJob& job,
                                                 const std::function<bool()>& is_unwanted);
  [[nodiscard]] RebuildSources sources_of(const StoredJob& job,
                                          const RebuildRequest& request) const;
  void settle(const StoredJob& job, const AttemptEnd& end, const std::stop_token& stop);
  void try_again(const StoredJob& job, const std::string& why);
  int count_full(const StoredJob& job);
  void try_again_with_room(const StoredJob& job, const std::string& why,
                           const std::stop_token& stop);
  void begin_to_publish(const JobFolder& folder, const std::stop_token& stop);
  void publish(const StoredJob& job, const std::stop_token& stop);
  void give_up_publishing(const StoredJob& job);
  [[nodiscard]] bool is_canceled(const StoredJob& job) const;
  void fail(const StoredJob& job, const std::string& why);
  [[nodiscard]] JobOutcome activate(const StoredJob& job, const StoredVersion& version);
  void ended(const StoredJob& job);
  void let_go(std::int64_t id);
  void note_progress(const StoredJob& job, const JobProgress& progress);
  void check_room(const std::string& map, const RebuildRequest& request,
                  const RebuildSources& sources, std::chrono::seconds most,
                  const std::function<bool()>& is_unwanted);
  void check_waiting() const;
  void check_new_version(const std::string& map, const std::string& version) const;
  void check_free_name(const std::string& map, const std::string& version) const;
  /// With the corrections that it is to use, as they are now.
  [[nodiscard]] RebuildRequest with_saved_edits(const std::string& map,
                                                RebuildRequest request) const;
  [[nodiscard]] bool is_known_request(const std::string& map, const Asker& asker) const;
  [[nodiscard]] std::optional<StoredJob> converted_before(const std::string& map,
                                                          const ConvertRequest& request) const;
  JobTable::Enqueued enqueue_convert(const std::string& map, const ConvertRequest& request,
                                     const Asker& asker);
  [[nodiscard]] bool wants_cancel(std::int64_t id);
  void clear_uploads(bool halves_too);
  [[nodiscard]] std::filesystem::path upload(const std::string& sha256) const;
  [[nodiscard]] ProcessLimits limits() const;
  [[nodiscard]] std::string without_places(std::string text) const;
  void wake();

  Setup setup_;
  std::filesystem::path root_;
  std::string mapper_missing_;
  /// Held while the files of uploads and the jobs that name them change together, and from the look
  /// whether a version is free to the job that makes it.
  std::mutex uploads_mutex_;
  std::uint64_t incoming_ = 0;
  /// Files that are coming, and those that came and whose job is not there yet.
  std::multiset<std::string> held_;
  std::mutex take_over_mutex_;
  /// Of the store's folder of jobs, and of the one to work in; `take_over_mutex_` guards them.
  std::vector<Descriptor> locks_;
  mutable std::mutex mutex_;
  std::condition_variable_any changed_;
  /// Grows when there may be work.
  std::uint64_t wakes_ = 0;
  std::map<std::int64_t, Active> active_;
  std::vector<std::jthread> threads_;  // last: they use all of the above
};

/// One line: status, stage, progress, eta_s, error.
[[nodiscard]] std::string job_event_json(const JobView& view);

}  // namespace stillmap::server
