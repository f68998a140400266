#pragma once

#include "jobs/job_runner.hpp"

#include <stillmap/maps/store/drive_store.hpp>
#include <stillmap/maps/store/package_store.hpp>
#include <stillmap/server/options_holder.hpp>

#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <thread>

namespace stillmap::server {

/// Removes what `RetentionOptions` let go of: finished jobs with their logs, drives, versions and
/// rows of the audit log. Each of them is tried, whatever becomes of the others.
/// @param now_ns  since 1970.
void keep_house(const RetentionOptions& options, maps::PackageStore& store,
                maps::DriveStore& drives, JobRunner& jobs, std::int64_t now_ns);

/// Does so a minute after the start, and then once an hour; makes the store's ballast at the start,
/// and within a minute after it was given up and there is room.
class Housekeeping {
 public:
  /// All of it outlives this.
  Housekeeping(const OptionsHolder& live, maps::PackageStore& store, maps::DriveStore& drives,
               JobRunner& jobs, bool keeps_ballast);
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
