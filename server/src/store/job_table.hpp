#pragma once

#include "store/store_refusal.hpp"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::server {

class StoreDatabase;

enum class JobKind : std::uint8_t { kRebuild, kConvert };
/// enqueued -> processing -> succeeded | failed | canceled; processing -> enqueued when it is tried
/// again; enqueued -> canceled.
enum class JobStatus : std::uint8_t { kEnqueued, kProcessing, kSucceeded, kFailed, kCanceled };

/// "rebuild", "convert".
[[nodiscard]] std::string_view name_of(JobKind kind);
/// "enqueued", "processing", "succeeded", "failed", "canceled".
[[nodiscard]] std::string_view name_of(JobStatus status);
/// Nothing for any other name.
[[nodiscard]] std::optional<JobStatus> job_status_of(std::string_view name);
/// Succeeded, failed or canceled: it never changes again.
[[nodiscard]] bool is_finished(JobStatus status);

/// What is asked for.
struct NewJob {
  JobKind kind = JobKind::kRebuild;
  std::string map{};
  /// What is to be done; the store does not read it.
  std::string request{};
  /// What makes two requests under one idempotency key the same; empty = `request`.
  std::string asked{};
  /// Complete drives of this map that it reads.
  std::vector<std::int64_t> drives{};
  /// The server in whose folder the files are that it reads, besides drives.
  std::string files_at{};
  /// Id of the key of who asks; empty without keys.
  std::string asker{};
  /// The asker's own name for this request.
  std::optional<std::string> idempotency_key{};
};

/// How far a job is.
struct JobAdvance {
  /// In [0, 1].
  double fraction = 0.0;
  /// Nothing until it can be told [s].
  std::optional<double> eta_s{};
  auto operator<=>(const JobAdvance&) const = default;
};

struct StoredJob {
  /// Grows with time, never given twice.
  std::int64_t id = 0;
  JobKind kind = JobKind::kRebuild;
  std::string map{};
  std::string request{};
  JobStatus status = JobStatus::kEnqueued;
  /// Of the latest attempt; empty before the first.
  std::string stage{};
  /// Why it failed or is tried again; else empty.
  std::string error{};
  /// What it has published: from then on it cannot be cancelled. Of one that failed, too.
  std::optional<std::string> result_version{};
  /// Times that it was claimed.
  std::int64_t attempts = 0;
  std::int64_t enqueued_ns = 0;
  /// Of the latest attempt.
  std::optional<std::int64_t> started_ns{};
  std::optional<std::int64_t> finished_ns{};
  std::string asker{};
  std::optional<std::string> idempotency_key{};
  /// Someone wants it to end, and whoever works on it has not ended it yet.
  bool cancel_requested = false;
  /// That claimed it last.
  std::string server{};
  /// The server in whose folder the files are that it reads; empty: any may have them.
  std::string files_at{};
  /// Of the latest attempt, as of its worker's last beat.
  JobAdvance advance{};
  /// JSON, of one that succeeded. Empty for one that an older program did.
  std::string outcome{};
  /// Attempts that crashed, or whose server ended while it worked on them.
  std::int64_t crashes = 0;
  auto operator<=>(const StoredJob&) const = default;
};

/// An attempt at a job, as whoever claimed it knows it. What it says of the job counts only while
/// no other attempt has begun.
struct JobClaim {
  std::int64_t id = 0;
  std::int64_t attempt = 0;
  JobClaim(const StoredJob& claimed)  // NOLINT(google-explicit-constructor): it is what is claimed
      : id(claimed.id), attempt(claimed.attempts) {}
  auto operator<=>(const JobClaim&) const = default;
};

/// Jobs of a store. What returned is kept. Safe from several threads. Throws StorageError when the
/// disk fails, StoreRefusal kUnknownJob for an id that is none.
class JobTable {
 public:
  struct Enqueued {
    StoredJob job;
    /// False when the asker sent the same request under the same idempotency key before.
    bool is_new = false;
  };
  /// @throws StoreRefusal kUnknownMap; kUnknownDrive, kDriveNotComplete for one of its drives;
  /// kOtherServer when they are in the folders of several servers; kOtherRequest when the asker
  /// used the idempotency key for something else.
  Enqueued enqueue(const NewJob& job, std::int64_t now_ns);
  /// The oldest enqueued one, which is then processing; nothing when none waits. Each goes to one
  /// caller only. @param server  which works on it. @param files_at  only jobs that read files of
  /// these; empty: any job.
  std::optional<StoredJob> claim(std::int64_t now_ns, std::string_view server = {},
                                 const std::vector<std::string>& files_at = {});
  /// Whoever works on a job says so every few seconds. @return false when it is not its any more.
  bool beat(const JobClaim& claim, const JobAdvance& advance = {});
  /// @throws StoreRefusal kNotProcessing.
  void set_stage(const JobClaim& claim, std::string_view stage);
  /// The revision at which the job may make its version the active one: that of its first attempt
  /// that came so far. @param revision  of the map now. @throws StoreRefusal kNotProcessing.
  std::int64_t activates_at(const JobClaim& claim, std::int64_t revision);
  /// Publishes nothing itself. @throws StoreRefusal kNotProcessing.
  StoredJob succeed(const JobClaim& claim, std::string_view result_version, std::int64_t now_ns,
                    std::string_view outcome = {});
  /// @throws StoreRefusal kNotProcessing.
  StoredJob fail(const JobClaim& claim, std::string_view error, std::int64_t now_ns);
  /// Its worker has ended it because it was asked to. @throws StoreRefusal kNotProcessing.
  StoredJob end_canceled(const JobClaim& claim, std::int64_t now_ns);
  enum class Crashed : std::uint8_t { kNo, kYes };
  /// Puts it back to its place in the queue, to be tried again; canceled when that was requested.
  /// @throws StoreRefusal kNotProcessing.
  StoredJob put_back(const JobClaim& claim, std::string_view error, std::int64_t now_ns,
                     Crashed crashed = Crashed::kNo);
  /// The last beat of one whose server ends in order and may not wait for it: put back for that, it
  /// has not crashed. @throws StoreRefusal kNotProcessing.
  void excuse(const JobClaim& claim);
  /// Puts back, as crashed unless excused, all that this server has claimed: after its restart
  /// nobody works on them. @return how many.
  std::size_t put_back_all(std::string_view error, std::int64_t now_ns,
                           std::string_view server = {});
  /// What is processing, and how often its worker has said so.
  struct Beat {
    JobClaim claim;
    std::int64_t beats = 0;
    auto operator<=>(const Beat&) const = default;
  };
  [[nodiscard]] std::vector<Beat> beats() const;
  /// Of jobs that are processing.
  [[nodiscard]] std::vector<std::int64_t> cancel_requests() const;
  /// Puts one back, as crashed unless excused, whose worker has not said anything since. @return
  /// whether it was so.
  bool put_back_silent(const Beat& last, std::string_view error, std::int64_t now_ns);
  /// One that waits is canceled at once, one that is processing is marked so; asking twice is
  /// asking once. @throws StoreRefusal kJobFinished when it succeeded, failed, or has published its
  /// version and is about to end.
  StoredJob request_cancel(std::int64_t id, std::int64_t now_ns);

  [[nodiscard]] StoredJob job(std::int64_t id) const;
  /// Drives that it was enqueued with, even removed ones.
  [[nodiscard]] std::vector<std::int64_t> drives(std::int64_t id) const;
  [[nodiscard]] std::size_t count(JobStatus status) const;

  struct Filter {
    std::optional<JobStatus> status{};
    std::optional<std::string> map{};
    /// Patterns, of which the map's name matches one; none: all maps.
    std::vector<std::string> maps{};
  };
  struct Page {
    /// Newest first.
    std::vector<StoredJob> jobs;
    /// Pass as `before` for those that follow; nothing at the end.
    std::optional<std::int64_t> next;
  };
  /// @param limit  1 to 1000; a page whose requests are long together ends before it.
  /// @param before  only older ones. @throws std::invalid_argument.
  [[nodiscard]] Page list(const Filter& filter, std::size_t limit,
                          std::optional<std::int64_t> before = {}) const;
  /// All that wait or are processing, newest first, as they were at one instant.
  [[nodiscard]] std::vector<StoredJob> unfinished() const;
  /// Removes those that finished before this time, with their idempotency keys. Of those that read
  /// a drive which is still there, only what finished before the other time too: they tell when it
  /// was used. @return how many.
  std::size_t forget_finished_before(std::int64_t time_ns, std::int64_t of_drives_ns);

 private:
  friend class StoreState;
  explicit JobTable(StoreDatabase& database) : database_(&database) {}
  StoreDatabase* database_;
};

}  // namespace stillmap::server
