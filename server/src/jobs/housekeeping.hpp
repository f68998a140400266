#pragma once

#include "jobs/job_folders.hpp"

#include <stillmap/server/options_holder.hpp>
#include "store/drive_store.hpp"
#include "store/package_store.hpp"

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <mutex>
#include <optional>
#include <thread>

namespace stillmap::server {

/// Removes what `RetentionOptions` let go of: finished jobs with their logs, drives, versions and
/// rows of the audit log. Each of them is tried, whatever becomes of the others.
/// @param now_ns  since 1970.
void keep_house(const RetentionOptions& options, PackageStore& store, DriveStore& drives,
                const JobFolders& jobs, std::int64_t now_ns);

/// The time by which retention tells what is old. This is the wall clock while it is at most a day
/// ahead of the time that was kept when the store was last in use. A clock that is further ahead
/// may be wrong (no battery, not set yet). Then only the time counts for which a server runs, so
/// that nothing is removed too early. A clock that goes on without a jump for three days of one run
/// is believed.
class RetentionClock {
 public:
  /// @param file  keeps the time over restarts. @param newest_ns  of what the store holds, where
  /// there is no such file yet; 0 = nothing.
  RetentionClock(std::filesystem::path file, std::int64_t newest_ns);
  /// @return never later than `wall_ns`.
  std::int64_t now_ns(std::int64_t wall_ns, std::chrono::steady_clock::time_point steady);

 private:
  void warn(std::int64_t wall_ns);

  std::filesystem::path file_;
  std::int64_t known_ns_;
  std::optional<std::chrono::steady_clock::time_point> counted_until_;
  /// Since when the wall clock goes on without a jump, and where it stood then.
  std::chrono::steady_clock::time_point agreed_since_;
  std::int64_t agreed_wall_ns_ = 0;
  bool warned_ = false;
};

/// The newest time that a row of the store tells; 0 without any.
[[nodiscard]] std::int64_t newest_time_ns(const PackageStore& store);

/// Does so a minute after the start, and then once an hour; makes the store's ballast at the start,
/// and within a minute after it was given up and there is room.
class Housekeeping {
 public:
  /// All of it outlives this.
  Housekeeping(const OptionsHolder& live, PackageStore& store, DriveStore& drives,
               const JobFolders& jobs, bool keeps_ballast);
  Housekeeping(const Housekeeping&) = delete;
  Housekeeping& operator=(const Housekeeping&) = delete;
  /// Waits for what it is at.
  ~Housekeeping() = default;

 private:
  std::mutex mutex_;
  std::condition_variable_any ended_;
  std::jthread thread_;  // last: it uses the above
};

}  // namespace stillmap::server
