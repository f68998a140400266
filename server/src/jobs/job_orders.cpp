#include "errors/api_error.hpp"
#include "jobs/job_runner.hpp"
#include "jobs/program_crash.hpp"
#include "store/free_bytes.hpp"
#include "store/ids_and_times.hpp"

#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <sys/stat.h>
#include <unistd.h>
#include <nlohmann/json.hpp>

#include <stillmap/maps/edits.hpp>
#include <stillmap/maps/error.hpp>
#include "store/received_file.hpp"

#include <algorithm>
#include <chrono>
#include <exception>
#include <set>
#include <system_error>

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

/// Jobs that may wait for their turn.
constexpr std::size_t kMostWaiting = 100;
/// Of a page of the store's list.
constexpr std::size_t kPage = 1000;
/// While a client waits for it, which gives up after 30 s and more. It reads a few scans of each
/// drive, and of a bag all that tells its topics and poses, which may be all of it.
constexpr std::chrono::seconds kMostForEstimate{20};
constexpr const char* kUploads = "uploads";

/// What `stillmap rebuild --estimate` says [bytes].
struct Estimate {
  std::uint64_t package = 0;
  std::uint64_t work = 0;
};

std::optional<Estimate> read_estimate(const std::string& text) {
  // Warnings may stand before it.
  const std::size_t begin = text.find("{\n");
  if (begin == std::string::npos) return std::nullopt;
  const auto json = nlohmann::json::parse(text.substr(begin), nullptr, false);
  if (!json.is_object() || !json.contains("package_bytes") || !json.contains("work_bytes") ||
      !json["package_bytes"].is_number_unsigned() || !json["work_bytes"].is_number_unsigned())
    return std::nullopt;
  return Estimate{.package = json["package_bytes"], .work = json["work_bytes"]};
}

std::string last_line(std::string text) {
  while (!text.empty() && (text.back() == '\n' || text.back() == ' ')) text.pop_back();
  const std::size_t begin = text.find_last_of('\n');
  return begin == std::string::npos ? text : text.substr(begin + 1);
}

bool on_one_disk(const fs::path& a, const fs::path& b) {
  struct stat first {};
  struct stat second {};
  return ::stat(a.c_str(), &first) == 0 && ::stat(b.c_str(), &second) == 0 &&
         first.st_dev == second.st_dev;
}

void require_room(const PackageStore& store, const fs::path& folder, std::uint64_t bytes) {
  const std::uint64_t room = free_bytes(folder);
  if (bytes <= room) return store.check_disk_reserve(folder, bytes);
  throw ApiError(ErrorCode::kDiskFull,
                 fmt::format("it needs about {} bytes, and {} are free", bytes, room));
}

/// The file that a convert job reads; empty for others.
std::string sha256_of(const StoredJob& job) {
  return job.kind == JobKind::kConvert ? read_convert_request(job.request).sha256 : std::string{};
}

}  // namespace

fs::path JobRunner::upload(const std::string& sha256) const { return root_ / kUploads / sha256; }

void JobRunner::check_room(const std::string& map, const RebuildRequest& request,
                           const RebuildSources& sources, std::chrono::seconds most,
                           const std::function<bool()>& is_unwanted) {
  if (setup_.mapper.empty())
    throw ApiError(ErrorCode::kNoMapper, "stillmap-mapper is not installed beside the server");
  const ProgramOutput output =
      run_short(estimate_command(setup_.mapper, request, sources), limits(), most, is_unwanted);
  const std::optional<Estimate> estimate = read_estimate(output.text);
  if (output.timed_out || output.end.exit_code != 0 || !estimate) {
    const std::string said = without_places(last_line(output.text));
    if (output.end.exit_code == 1 || output.end.exit_code == 2)
      throw ApiError(ErrorCode::kInvalidRequest, said);
    throw ProgramCrash("no estimate of the disk: " + output.end.words() +
                       (said.empty() ? "" : ": " + said));
  }
  setup_.store.check_quota(map, estimate->package);
  // The map is copied into the store before the job's folder is cleared.
  const bool shared = on_one_disk(root_, setup_.store.folder());
  require_room(setup_.store, root_, estimate->work + estimate->package * (shared ? 2 : 1));
  if (!shared) require_room(setup_.store, setup_.store.folder(), estimate->package);
}

void JobRunner::check_waiting() const {
  if (setup_.store.jobs().count(JobStatus::kEnqueued) < kMostWaiting) return;
  throw ApiError(ErrorCode::kBusy, fmt::format("{} jobs wait already", kMostWaiting))
      .with_header("Retry-After", "60");
}

void JobRunner::check_new_version(const std::string& map, const std::string& version) const {
  if (!setup_.store.state().find_version(map, version)) return;
  throw ApiError(ErrorCode::kOtherDigest,
                 fmt::format("map {} has a version {} already", map, version));
}

/// Told when it is asked for: hours later, when the map is made, it would be refused.
void JobRunner::check_free_name(const std::string& map, const std::string& version) const {
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

/// Then the room that it needs was looked at before, and is perhaps taken by itself now.
bool JobRunner::is_known_request(const std::string& map, const Asker& asker) const {
  if (!asker.idempotency_key) return false;
  std::optional<std::int64_t> before;
  do {
    const JobTable::Page page = setup_.store.jobs().list({.map = map}, kPage, before);
    for (const StoredJob& job : page.jobs)
      if (job.asker == asker.key_id && job.idempotency_key == asker.idempotency_key) return true;
    before = page.next;
  } while (before);
  return false;
}

RebuildRequest JobRunner::with_saved_edits(const std::string& map, RebuildRequest request) const {
  if (request.edits_from != RebuildRequest::EditsFrom::kSaved) return request;
  request.edits_from = RebuildRequest::EditsFrom::kNone;
  if (!takes_saved_edits(request)) return request;
  const SavedEdits saved = setup_.store.edits().of_map(map);
  if (maps::parse_edits(saved.text, "corrections of map " + map).empty()) return request;
  request.edits = saved.text;
  request.edits_from = RebuildRequest::EditsFrom::kSaved;
  return request;
}

JobTable::Enqueued JobRunner::rebuild(const std::string& map, const RebuildRequest& request,
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
    const std::vector<StoredDrive> drives = setup_.store.drives().of_map(map);
    for (const std::int64_t id : job.drives) {
      const auto drive = std::find_if(drives.begin(), drives.end(),
                                      [&](const auto& each) { return each.id == id; });
      if (drive == drives.end())
        throw ApiError(ErrorCode::kUnknownDrive, fmt::format("map {} has no drive {}", map, id));
      if (drive->status != DriveStatus::kComplete)
        throw ApiError(ErrorCode::kDriveNotComplete,
                       fmt::format("drive {} is {}", id, name_of(drive->status)));
    }
    fs::create_directories(root_);
    try {
      check_room(map, request, sources_of({.map = map}, request), kMostForEstimate,
                 [] { return false; });
    } catch (const ProgramCrash& error) {
      // The job looks for itself, has time, and says what is wrong.
      spdlog::warn("a rebuild of {} begins without knowing its room: {}", map, error.what());
    }
  }
  // Another one may have come during the estimate.
  const std::scoped_lock lock(uploads_mutex_);
  if (!request.version.empty() && !is_known_request(map, asker))
    check_free_name(map, request.version);
  JobTable::Enqueued enqueued = setup_.store.jobs().enqueue(job, unix_ns());
  wake();
  return enqueued;
}

/// The job that made this version of the same file, as long as it is remembered.
std::optional<StoredJob> JobRunner::converted_before(const std::string& map,
                                                     const ConvertRequest& request) const {
  if (!setup_.store.state().find_version(map, request.version)) return std::nullopt;
  std::optional<std::int64_t> before;
  do {
    const JobTable::Page page =
        setup_.store.jobs().list({.status = JobStatus::kSucceeded, .map = map}, kPage, before);
    for (const StoredJob& job : page.jobs)
      if (job.result_version == request.version)
        return sha256_of(job) == request.sha256 ? std::optional(job) : std::nullopt;
    before = page.next;
  } while (before);
  return std::nullopt;
}

std::optional<StoredJob> JobRunner::newest_conversion(const std::string& map,
                                                      const std::string& version) const {
  std::optional<std::int64_t> before;
  do {
    const JobTable::Page page = setup_.store.jobs().list({.map = map}, kPage, before);
    for (const StoredJob& job : page.jobs)
      if (job.kind == JobKind::kConvert && version_of(job) == version) return job;
    before = page.next;
  } while (before);
  return std::nullopt;
}

JobTable::Enqueued JobRunner::convert(const std::string& map, const ConvertRequest& request,
                                      const Asker& asker) {
  // A file that no job will read counts towards no quota.
  const auto clear = [this] {
    try {
      clear_uploads(false);
    } catch (const std::exception& error) {
      spdlog::error("uploads that no job reads: {}", error.what());
    }
  };
  try {
    JobTable::Enqueued enqueued = enqueue_convert(map, request, asker);
    if (is_finished(enqueued.job.status)) clear();
    return enqueued;
  } catch (...) {
    clear();
    throw;
  }
}

JobTable::Enqueued JobRunner::enqueue_convert(const std::string& map, const ConvertRequest& request,
                                              const Asker& asker) {
  const std::scoped_lock lock(uploads_mutex_);
  if (const auto held = held_.find(request.sha256); held != held_.end()) held_.erase(held);
  for (const StoredJob& job : setup_.store.jobs().unfinished()) {
    if (job.map != map || version_of(job) != request.version) continue;
    if (sha256_of(job) == request.sha256) return {job, false};
    throw ApiError(ErrorCode::kOtherDigest, fmt::format("job {} makes version {} of something else",
                                                        job.id, request.version));
  }
  if (const auto done = converted_before(map, request)) return {*done, false};
  check_new_version(map, request.version);
  check_waiting();
  std::error_code error;
  if (!fs::exists(upload(request.sha256), error))
    throw maps::StorageError(upload(request.sha256).string(), "is gone");
  check_upload_quota(map, fs::file_size(upload(request.sha256)));
  setup_.store.create_map(map);
  JobTable::Enqueued enqueued = setup_.store.jobs().enqueue({.kind = JobKind::kConvert,
                                                             .map = map,
                                                             .request = to_json(request),
                                                             .asker = asker.key_id,
                                                             .idempotency_key = std::nullopt},
                                                            unix_ns());
  wake();
  return enqueued;
}

std::string JobRunner::receive(const ByteSource& source, std::uint64_t bytes,
                               const std::optional<std::string>& sha256, const std::string& name) {
  const fs::path folder = root_ / kUploads;
  std::string half;
  {
    const std::scoped_lock lock(uploads_mutex_);
    fs::create_directories(folder);
    // Several servers may share the folder.
    half = fmt::format(".incoming-{}-{}", ::getpid(), incoming_++);
    held_.insert(half);
  }
  std::error_code error;
  try {
    std::string found =
        receive_file(setup_.store.leaving_reserve(source), bytes, folder / half, name);
    if (sha256 && *sha256 != found) throw maps::InputError(name, "SHA-256 " + found, *sha256);
    const std::scoped_lock lock(uploads_mutex_);
    fs::rename(folder / half, folder / found);
    sync_folder(folder);
    sync_folder(root_);
    held_.insert(found);
    held_.erase(half);
    return found;
  } catch (...) {
    const std::scoped_lock lock(uploads_mutex_);
    fs::remove(folder / half, error);
    held_.erase(half);
    throw;
  }
}

void JobRunner::check_upload_quota(const std::string& map, std::uint64_t bytes) const {
  WaitingBytes waiting;
  std::set<std::string> of_map, of_store;
  const auto count = [&](std::set<std::string>& counted, const std::string& sha256) {
    std::error_code error;
    // Several jobs may read one file.
    const bool is_first = counted.insert(sha256).second;
    const std::uintmax_t size = is_first ? fs::file_size(upload(sha256), error) : 0;
    return error ? 0 : size;
  };
  for (const StoredJob& job : setup_.store.jobs().unfinished()) {
    const std::string sha256 = sha256_of(job);
    if (sha256.empty()) continue;
    waiting.of_store += count(of_store, sha256);
    if (job.map == map) waiting.of_map += count(of_map, sha256);
  }
  setup_.store.check_quota(map, bytes, waiting);
}

/// Files that no job will read. What comes in right now stays; unless it is said to be left over,
/// when it comes to another server.
void JobRunner::clear_uploads(bool halves_too) {
  const std::scoped_lock lock(uploads_mutex_);
  std::set<std::string> needed(held_.begin(), held_.end());
  for (const StoredJob& job : setup_.store.jobs().unfinished()) needed.insert(sha256_of(job));
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(root_ / kUploads, error)) {
    const std::string name = entry.path().filename().string();
    const bool stays = !halves_too && name.starts_with(".");
    if (!stays && !needed.contains(name)) fs::remove(entry.path(), error);
  }
}

}  // namespace stillmap::server
