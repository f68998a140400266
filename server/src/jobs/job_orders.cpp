#include "jobs/job_orders.hpp"

#include "errors/api_error.hpp"
#include "jobs/job_sources.hpp"
#include "store/ids_and_times.hpp"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <stillmap/maps/edits.hpp>
#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <chrono>
#include <exception>
#include <filesystem>
#include <system_error>
#include <utility>

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

/// Jobs that may wait for their turn.
constexpr std::size_t kMostWaiting = 100;
/// While a client waits for it, which gives up after 30 s and more. It reads a few scans of each
/// drive, and of a bag all that tells its topics and poses, which may be all of it.
constexpr std::chrono::seconds kMostForEstimate{20};

/// The newest of these jobs for which this holds.
template <typename Holds>
std::optional<StoredJob> find_newest(const JobTable& table, const JobTable::Filter& filter,
                                     Holds&& holds) {
  constexpr std::size_t kPage = 1000;
  std::optional<std::int64_t> before;
  do {
    const JobTable::Page page = table.list(filter, kPage, before);
    for (const StoredJob& job : page.jobs)
      if (holds(job)) return job;
    before = page.next;
  } while (before);
  return std::nullopt;
}

}  // namespace

JobOrders::JobOrders(const JobSetup& setup, const JobFolders& folders, JobUploads& uploads,
                     std::function<void()> wake)
    : setup_(setup),
      folders_(folders),
      uploads_(uploads),
      wake_(std::move(wake)),
      room_(setup, folders) {}

void JobOrders::check_waiting() const {
  if (setup_.store.jobs().count(JobStatus::kEnqueued) < kMostWaiting) return;
  throw ApiError(ErrorCode::kBusy, fmt::format("{} jobs wait already", kMostWaiting))
      .with_header("Retry-After", "60");
}

void JobOrders::check_new_version(const std::string& map, const std::string& version) const {
  if (!setup_.store.state().find_version(map, version)) return;
  throw ApiError(ErrorCode::kOtherDigest,
                 fmt::format("map {} has a version {} already", map, version));
}

/// Told when it is asked for: hours later, when the map is made, it would be refused.
void JobOrders::check_free_name(const std::string& map, const std::string& version) const {
  check_new_version(map, version);
  if (setup_.store.state().retired(map, version)) {
    throw ApiError(ErrorCode::kOtherDigest,
                   fmt::format("map {} had a version {}, which was removed: a new one needs a name "
                               "that was never used",
                               map, version));
  }
  for (const StoredJob& job : setup_.store.jobs().unfinished()) {
    if (job.map == map && version_of(job) == version)
      throw ApiError(ErrorCode::kOtherDigest,
                     fmt::format("job {} makes version {} already", job.id, version));
  }
}

bool JobOrders::check_drives(const NewJob& job) const {
  bool are_here = true;
  const std::vector<StoredDrive> drives = setup_.store.drives().of_map(job.map);
  for (const std::int64_t id : job.drives) {
    const auto drive =
        std::find_if(drives.begin(), drives.end(), [&](const auto& each) { return each.id == id; });
    if (drive == drives.end())
      throw ApiError(ErrorCode::kUnknownDrive, fmt::format("map {} has no drive {}", job.map, id));
    if (drive->status == DriveStatus::kNeedsChoice)
      throw ApiError(ErrorCode::kDriveNotComplete,
                     fmt::format("drive {} needs a choice of topics: complete it with one", id));
    if (drive->status != DriveStatus::kComplete)
      throw ApiError(ErrorCode::kDriveNotComplete,
                     fmt::format("drive {} is {}", id, name_of(drive->status)));
    are_here = are_here && folders_.has_files_of(drive->files_at);
  }
  return are_here;
}

void JobOrders::check_room(const std::string& map, const RebuildRequest& request) const {
  fs::create_directories(folders_.root());
  try {
    room_.check(map, request, sources_now(setup_, map, request), kMostForEstimate,
                [] { return false; });
  } catch (const ProgramCrash& error) {
    // The job looks for itself, has time, and says what is wrong.
    spdlog::warn("a rebuild of {} begins without knowing its room: {}", map, error.what());
  }
}

/// Then the room that it needs was looked at before, and is perhaps taken by itself now.
bool JobOrders::is_known_request(const std::string& map, const Asker& asker) const {
  if (!asker.idempotency_key) return false;
  const auto is_it = [&](const StoredJob& job) {
    return job.asker == asker.key_id && job.idempotency_key == asker.idempotency_key;
  };
  return find_newest(setup_.store.jobs(), {.map = map}, is_it).has_value();
}

/// With the corrections that it is to use, as they are now.
RebuildRequest JobOrders::with_saved_edits(const std::string& map, RebuildRequest request) const {
  if (request.edits_from != RebuildRequest::EditsFrom::kSaved) return request;
  request.edits_from = RebuildRequest::EditsFrom::kNone;
  if (!takes_saved_edits(request)) return request;
  const SavedEdits saved = setup_.store.edits().of_map(map);
  if (maps::parse_edits(saved.text, "corrections of map " + map).empty()) return request;
  request.edits = saved.text;
  request.edits_from = RebuildRequest::EditsFrom::kSaved;
  return request;
}

JobTable::Enqueued JobOrders::rebuild(const std::string& map, const RebuildRequest& request,
                                      const Asker& asker) {
  NewJob job{.kind = JobKind::kRebuild,
             .map = map,
             .request = to_stored_json(with_saved_edits(map, request)),
             .asked = to_json(request),
             .drives = request.drives,
             .asker = asker.key_id,
             .idempotency_key = asker.idempotency_key};
  if (request.held_back) job.drives.push_back(*request.held_back);
  static_cast<void>(setup_.store.state().map(map));
  if (!is_known_request(map, asker)) {
    check_waiting();
    if (!request.version.empty()) check_free_name(map, request.version);
    // The server that has the drives looks before it begins.
    if (check_drives(job)) check_room(map, request);
  }
  // Another one may have come during the estimate.
  const std::scoped_lock lock(mutex_);
  if (!request.version.empty() && !is_known_request(map, asker))
    check_free_name(map, request.version);
  JobTable::Enqueued enqueued = setup_.store.jobs().enqueue(job, unix_ns());
  wake_();
  return enqueued;
}

/// The job that made this version of the same file, as long as it is remembered.
std::optional<StoredJob> JobOrders::converted_before(const std::string& map,
                                                     const ConvertRequest& request) const {
  if (!setup_.store.state().find_version(map, request.version)) return std::nullopt;
  const auto maker =
      find_newest(setup_.store.jobs(), {.status = JobStatus::kSucceeded, .map = map},
                  [&](const StoredJob& job) { return job.result_version == request.version; });
  return maker && sha256_of(*maker) == request.sha256 ? maker : std::nullopt;
}

std::optional<StoredJob> JobOrders::newest_conversion(const std::string& map,
                                                      const std::string& version) const {
  return find_newest(setup_.store.jobs(), {.map = map}, [&](const StoredJob& job) {
    return job.kind == JobKind::kConvert && version_of(job) == version;
  });
}

JobTable::Enqueued JobOrders::convert(const std::string& map, const ConvertRequest& request,
                                      const Asker& asker) {
  try {
    JobTable::Enqueued enqueued = enqueue_convert(map, request, asker);
    uploads_.release(request.sha256);
    return enqueued;
  } catch (...) {
    uploads_.release(request.sha256);
    throw;
  }
}

JobTable::Enqueued JobOrders::enqueue_convert(const std::string& map, const ConvertRequest& request,
                                              const Asker& asker) {
  const std::scoped_lock lock(mutex_);
  for (const StoredJob& job : setup_.store.jobs().unfinished()) {
    if (job.map != map || version_of(job) != request.version) continue;
    if (sha256_of(job) == request.sha256) return {job, false};
    throw ApiError(ErrorCode::kOtherDigest, fmt::format("job {} makes version {} of something else",
                                                        job.id, request.version));
  }
  if (const auto done = converted_before(map, request)) return {*done, false};
  check_new_version(map, request.version);
  check_waiting();
  const fs::path file = uploads_.file(request.sha256);
  std::error_code error;
  if (!fs::exists(file, error)) throw maps::StorageError(file.string(), "is gone");
  uploads_.check_quota(map, fs::file_size(file));
  setup_.store.create_map(map);
  JobTable::Enqueued enqueued = setup_.store.jobs().enqueue({.kind = JobKind::kConvert,
                                                             .map = map,
                                                             .request = to_json(request),
                                                             .files_at = folders_.server(),
                                                             .asker = asker.key_id,
                                                             .idempotency_key = std::nullopt},
                                                            unix_ns());
  wake_();
  return enqueued;
}

}  // namespace stillmap::server
