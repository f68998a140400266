#include "jobs/housekeeping.hpp"

#include "jobs/job_folder.hpp"
#include "store/ids_and_times.hpp"

#include <spdlog/spdlog.h>

#include "store/store_refusal.hpp"

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cstdlib>
#include <exception>
#include <string>
#include <system_error>
#include <utility>

namespace stillmap::server {
namespace {

constexpr std::int64_t kDay_ns = std::int64_t{86'400} * 1'000'000'000;
/// Disks note that a file was read once a day.
constexpr std::int64_t kDerivedKept_ns = 2 * kDay_ns;
/// In the store's folder: nanoseconds since 1970.
constexpr const char* kRetentionClock = "retention-clock";

template <typename Work>
void attempt(const char* what, Work&& work) {
  try {
    std::forward<Work>(work)();
  } catch (const std::exception& error) {
    spdlog::error("housekeeping of {}: {}", what, error.what());
  }
}

/// When it came, or when the last job that read it ended.
std::int64_t last_use_ns(const PackageStore& store, const StoredDrive& drive) {
  std::int64_t last = drive.finished_ns.value_or(drive.created_ns);
  for (const std::int64_t id : store.state().drives().jobs_using(drive.id)) {
    try {
      const StoredJob job = store.state().jobs().job(id);
      last = std::max(last, job.finished_ns.value_or(job.enqueued_ns));
    } catch (const StoreRefusal&) {
      // The store has forgotten the job meanwhile.
    }
  }
  return last;
}

void remove_old_drives(PackageStore& store, DriveStore& drives, std::int64_t before) {
  for (const StoredDrive& drive : store.drives().all()) {
    if (last_use_ns(store, drive) >= before) continue;
    attempt("a drive", [&] {
      try {
        drives.remove(drive.id);
        spdlog::info("drive {} of {} was not used for long and is gone", drive.id, drive.map);
      } catch (const StoreRefusal&) {
        // A job reads it.
      }
    });
  }
}

void remove_old_versions(PackageStore& store, std::size_t kept) {
  for (const StoredMap& map : store.state().maps()) {
    attempt("versions", [&] {
      for (const std::string& version : store.keep_newest(map.name, kept))
        spdlog::info("version {} of {} is gone: newer ones are kept", version, map.name);
    });
  }
}

}  // namespace

void keep_house(const RetentionOptions& options, PackageStore& store, DriveStore& drives,
                const JobFolders& jobs, std::int64_t now_ns) {
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
  attempt("what was made of versions", [&] { store.drop_derived(now_ns - kDerivedKept_ns); });
  if (options.versions > 0) {
    attempt("versions",
            [&] { remove_old_versions(store, static_cast<std::size_t>(options.versions)); });
  }
}

RetentionClock::RetentionClock(std::filesystem::path file, std::int64_t newest_ns)
    : file_(std::move(file)), known_ns_(newest_ns) {
  const std::optional<std::string> text = read_small_file(file_);
  if (!text) return;
  std::int64_t kept = 0;
  const auto [end, error] = std::from_chars(text->data(), text->data() + text->size(), kept);
  if (error == std::errc{} && end == text->data() + text->size()) known_ns_ = kept;
}

std::int64_t RetentionClock::now_ns(std::int64_t wall_ns,
                                    std::chrono::steady_clock::time_point steady) {
  if (counted_until_)
    known_ns_ +=
        std::chrono::duration_cast<std::chrono::nanoseconds>(steady - *counted_until_).count();
  constexpr std::int64_t kJump_ns = kDay_ns / 24;
  constexpr std::chrono::hours kBelievedAfter{72};
  const auto agreed = std::chrono::duration_cast<std::chrono::nanoseconds>(steady - agreed_since_);
  if (!counted_until_ || std::abs(wall_ns - agreed_wall_ns_ - agreed.count()) > kJump_ns) {
    agreed_since_ = steady;
    agreed_wall_ns_ = wall_ns;
  }
  counted_until_ = steady;
  if (steady - agreed_since_ >= kBelievedAfter) known_ns_ = wall_ns;
  // A store without anything has nothing to lose.
  if (known_ns_ == 0 || (wall_ns > known_ns_ && wall_ns - known_ns_ <= kDay_ns))
    known_ns_ = wall_ns;
  if (wall_ns > known_ns_) warn(wall_ns);
  try {
    write_small_file(file_, std::to_string(known_ns_));
  } catch (const std::exception& error) {
    // The next one begins where the last one that was written ended.
    spdlog::warn("{}", error.what());
  }
  return std::min(known_ns_, wall_ns);
}

void RetentionClock::warn(std::int64_t wall_ns) {
  if (std::exchange(warned_, true)) return;
  spdlog::warn(
      "the clock is {} days ahead of when this store was last in use: retention does not count "
      "them, so nothing is removed for being old by the clock alone. If the clock is wrong, set "
      "it. If it is right, it is believed after three days without a stop, or at once when {} is "
      "removed while the server is stopped",
      (wall_ns - known_ns_) / kDay_ns, file_.string());
}

std::int64_t newest_time_ns(const PackageStore& store) {
  std::int64_t newest = 0;
  for (const AuditRecord& row : store.state().audit().list(1).records)
    newest = std::max(newest, row.time_ns);
  for (const StoredJob& job : store.state().jobs().list({}, 1).jobs)
    newest = std::max(newest, job.finished_ns.value_or(job.enqueued_ns));
  for (const StoredDrive& drive : store.state().drives().all())
    newest = std::max(newest, drive.finished_ns.value_or(drive.created_ns));
  for (const StoredMap& map : store.state().maps())
    for (const StoredVersion& version : store.state().versions(map.name))
      newest = std::max(newest, version.created_ns);
  return newest;
}

Housekeeping::Housekeeping(const OptionsHolder& live, PackageStore& store, DriveStore& drives,
                           const JobFolders& jobs, bool keeps_ballast) {
  thread_ = std::jthread(
      [this, &live, &store, &drives, &jobs, keeps_ballast](const std::stop_token& stop) {
        constexpr int kMinutesBetween = 60;
        int minutes_left = 1;
        std::optional<RetentionClock> clock;
        const auto find_clock = [&] {
          if (clock || !store.read_only_because().empty()) return;
          clock.emplace(store.folder() / kRetentionClock, newest_time_ns(store));
        };
        // Before rows are written by a clock that may be wrong.
        attempt("the clock", find_clock);
        while (true) {
          if (keeps_ballast) attempt("the ballast", [&] { store.state().keep_ballast(); });
          {
            std::unique_lock lock(mutex_);
            ended_.wait_for(lock, stop, std::chrono::minutes{1}, [] { return false; });
          }
          if (stop.stop_requested()) return;
          if (--minutes_left > 0) continue;
          attempt("the clock", [&] {
            find_clock();
            if (!clock) return;
            keep_house(live.current()->retention, store, drives, jobs,
                       clock->now_ns(unix_ns(), std::chrono::steady_clock::now()));
          });
          minutes_left = kMinutesBetween;
        }
      });
}

}  // namespace stillmap::server
