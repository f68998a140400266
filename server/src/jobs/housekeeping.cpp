#include "jobs/housekeeping.hpp"

#include "ids_and_times.hpp"

#include <spdlog/spdlog.h>

#include <stillmap/maps/store/store_refusal.hpp>

#include <algorithm>
#include <chrono>
#include <exception>
#include <utility>

namespace stillmap::server {
namespace {

constexpr std::int64_t kDay_ns = std::int64_t{86'400} * 1'000'000'000;

template <typename Work>
void attempt(const char* what, Work&& work) {
  try {
    std::forward<Work>(work)();
  } catch (const std::exception& error) {
    spdlog::error("housekeeping of {}: {}", what, error.what());
  }
}

/// When it came, or when the last job that read it ended.
std::int64_t last_use_ns(const maps::PackageStore& store, const maps::StoredDrive& drive) {
  std::int64_t last = drive.finished_ns.value_or(drive.created_ns);
  for (const std::int64_t id : store.state().drives().jobs_using(drive.id)) {
    try {
      const maps::StoredJob job = store.state().jobs().job(id);
      last = std::max(last, job.finished_ns.value_or(job.enqueued_ns));
    } catch (const maps::StoreRefusal&) {
      // The store has forgotten the job meanwhile.
    }
  }
  return last;
}

void remove_old_drives(maps::PackageStore& store, maps::DriveStore& drives, std::int64_t before) {
  for (const maps::StoredDrive& drive : store.drives().all()) {
    if (last_use_ns(store, drive) >= before) continue;
    attempt("a drive", [&] {
      try {
        drives.remove(drive.id);
        spdlog::info("drive {} of {} was not used for long and is gone", drive.id, drive.map);
      } catch (const maps::StoreRefusal&) {
        // A job reads it.
      }
    });
  }
}

void remove_old_versions(maps::PackageStore& store, std::size_t kept) {
  for (const maps::StoredMap& map : store.state().maps()) {
    attempt("versions", [&] {
      for (const std::string& version : store.keep_newest(map.name, kept))
        spdlog::info("version {} of {} is gone: newer ones are kept", version, map.name);
    });
  }
}

}  // namespace

void keep_house(const RetentionOptions& options, maps::PackageStore& store,
                maps::DriveStore& drives, JobRunner& jobs, std::int64_t now_ns) {
  if (!store.read_only_because().empty()) return;
  // Drives that stay for good need no job that tells when they were used.
  const std::int64_t drives_before =
      options.drive_days > 0 ? now_ns - options.drive_days * kDay_ns : now_ns;
  // Before jobs are forgotten, which say when a drive was used.
  if (options.drive_days > 0)
    attempt("drives", [&] { remove_old_drives(store, drives, drives_before); });
  if (options.job_days > 0) {
    attempt("jobs", [&] {
      store.jobs().forget_finished_before(now_ns - options.job_days * kDay_ns, drives_before);
    });
  }
  attempt("folders of jobs", [&] { jobs.clear_forgotten(); });
  if (options.audit_days > 0)
    attempt("the audit log", [&] {
      store.even_when_full([&] { store.audit().remove_older_than(options.audit_days, now_ns); });
    });
  if (options.versions > 0) {
    attempt("versions",
            [&] { remove_old_versions(store, static_cast<std::size_t>(options.versions)); });
  }
}

Housekeeping::Housekeeping(const OptionsHolder& live, maps::PackageStore& store,
                           maps::DriveStore& drives, JobRunner& jobs, bool keeps_ballast) {
  thread_ = std::jthread(
      [this, &live, &store, &drives, &jobs, keeps_ballast](const std::stop_token& stop) {
        constexpr int kMinutesBetween = 60;
        int minutes_left = 1;
        while (true) {
          if (keeps_ballast) attempt("the ballast", [&] { store.state().keep_ballast(); });
          {
            std::unique_lock lock(mutex_);
            ended_.wait_for(lock, stop, std::chrono::minutes{1}, [] { return false; });
          }
          if (stop.stop_requested()) return;
          if (--minutes_left > 0) continue;
          keep_house(live.current()->retention, store, drives, jobs, unix_ns());
          minutes_left = kMinutesBetween;
        }
      });
}

}  // namespace stillmap::server
