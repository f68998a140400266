#include "jobs/job_uploads.hpp"

#include "jobs/job_request.hpp"

#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <stillmap/maps/error.hpp>
#include "store/received_file.hpp"

#include <exception>
#include <system_error>

namespace stillmap::server {

namespace fs = std::filesystem;

std::string sha256_of(const StoredJob& job) {
  return job.kind == JobKind::kConvert ? read_convert_request(job.request).sha256 : std::string{};
}

fs::path JobUploads::file(const std::string& sha256) const { return folders_.uploads() / sha256; }

std::string JobUploads::receive(const ByteSource& source, std::uint64_t bytes,
                                const std::optional<std::string>& sha256, const std::string& name) {
  const fs::path folder = folders_.uploads();
  std::string half;
  {
    const std::scoped_lock lock(mutex_);
    fs::create_directories(folder);
    // Several servers may share the folder.
    half = fmt::format(".incoming-{}-{}", ::getpid(), incoming_++);
    held_.insert(half);
  }
  std::error_code error;
  try {
    std::string found = receive_file(store_.leaving_reserve(source), bytes, folder / half, name);
    if (sha256 && *sha256 != found) throw maps::InputError(name, "SHA-256 " + found, *sha256);
    const std::scoped_lock lock(mutex_);
    fs::rename(folder / half, folder / found);
    sync_folder(folder);
    sync_folder(folders_.root());
    held_.insert(found);
    held_.erase(half);
    return found;
  } catch (...) {
    const std::scoped_lock lock(mutex_);
    fs::remove(folder / half, error);
    held_.erase(half);
    throw;
  }
}

void JobUploads::release(const std::string& sha256) {
  {
    const std::scoped_lock lock(mutex_);
    // Once: the same file may have come several times.
    if (const auto held = held_.find(sha256); held != held_.end()) held_.erase(held);
  }
  try {
    clear_unused();
  } catch (const std::exception& error) {
    spdlog::error("uploads that no job reads: {}", error.what());
  }
}

void JobUploads::check_quota(const std::string& map, std::uint64_t bytes) const {
  WaitingBytes waiting;
  std::set<std::string> of_map, of_store;
  const auto count = [&](std::set<std::string>& counted, const std::string& sha256) {
    std::error_code error;
    // Several jobs may read one file.
    const bool is_first = counted.insert(sha256).second;
    const std::uintmax_t size = is_first ? fs::file_size(file(sha256), error) : 0;
    return error ? 0 : size;
  };
  for (const StoredJob& job : store_.jobs().unfinished()) {
    const std::string sha256 = sha256_of(job);
    if (sha256.empty()) continue;
    waiting.of_store += count(of_store, sha256);
    if (job.map == map) waiting.of_map += count(of_map, sha256);
  }
  store_.check_quota(map, bytes, waiting);
}

void JobUploads::clear(bool halves_too) {
  const std::scoped_lock lock(mutex_);
  // First what is held, then the jobs: a file is released only when its job is among them.
  std::set<std::string> needed(held_.begin(), held_.end());
  for (const StoredJob& job : store_.jobs().unfinished()) needed.insert(sha256_of(job));
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folders_.uploads(), error)) {
    const std::string name = entry.path().filename().string();
    const bool stays = !halves_too && name.starts_with(".");
    if (!stays && !needed.contains(name)) fs::remove(entry.path(), error);
  }
}

}  // namespace stillmap::server
