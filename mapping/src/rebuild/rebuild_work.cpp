#include "rebuild/rebuild_work.hpp"

#include "pipeline/build_key.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/text.hpp>

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <system_error>
#include <utility>

namespace stillmap::mapping {
namespace {

namespace fs = std::filesystem;

constexpr const char* kKeyName = "rebuild.key";
constexpr const char* kDone = ".done";

[[noreturn]] void fail(const fs::path& path) {
  throw maps::StorageError(path.string(), std::strerror(errno));
}

void sync_folder(const fs::path& folder) {
  const int descriptor = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor < 0) fail(folder);
  ::fsync(descriptor);
  ::close(descriptor);
}

/// Whole or not at all, whatever happens meanwhile.
void replace_file(const fs::path& file, std::string_view text) {
  const fs::path partial = file.string() + ".partial";
  const int descriptor = ::open(partial.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (descriptor < 0) fail(partial);
  for (std::string_view left = text; !left.empty();) {
    const ssize_t written = ::write(descriptor, left.data(), left.size());
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) {
      const int reason = errno;
      ::close(descriptor);
      errno = reason;
      fail(partial);
    }
    left.remove_prefix(static_cast<std::size_t>(written));
  }
  const int result = ::fsync(descriptor);
  ::close(descriptor);
  if (result != 0 || ::rename(partial.c_str(), file.c_str()) != 0) fail(file);
  sync_folder(file.parent_path());
}

/// Nothing, or what was left of writing the key.
bool is_new(const fs::path& folder) {
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.path().filename().string() != kKeyName + std::string(".partial")) return false;
  }
  return true;
}

}  // namespace

RebuildWork::RebuildWork(fs::path folder, const std::string& key) : folder_(std::move(folder)) {
  std::error_code error;
  fs::create_directories(folder_, error);
  if (error) throw maps::StorageError(folder_.string(), error.message());
  const fs::path key_file = folder_ / kKeyName;
  if (!fs::exists(key_file) && !is_new(folder_))
    throw maps::InputError(folder_.string(), "other things than a rebuild's work",
                           "an empty folder, or one that a rebuild worked in: give another --work");
  lock_ = ::open(folder_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (lock_ < 0) fail(folder_);
  if (::flock(lock_, LOCK_EX | LOCK_NB) != 0) {
    ::close(lock_);
    throw maps::InputError(folder_.string(), "a folder that another rebuild works in",
                           "none: wait for that rebuild, or give another --work");
  }
  try {
    const std::string found = fs::exists(key_file) ? maps::read_text(key_file) : "";
    if (found == key) return;
    if (!found.empty()) discarded_ = key_difference(found, key);
    // Empty while the rest goes: who comes back under the old key finds no half of its work.
    replace_file(key_file, "");
    clear();
    replace_file(key_file, key);
  } catch (...) {
    ::close(lock_);
    throw;
  }
}

RebuildWork::~RebuildWork() { ::close(lock_); }

void RebuildWork::clear() {
  std::error_code error;
  // The key stays: by it the folder is known to be a rebuild's.
  for (const auto& entry : fs::directory_iterator(folder_)) {
    if (entry.path().filename() != kKeyName) fs::remove_all(entry.path(), error);
    if (error) throw maps::StorageError(entry.path().string(), error.message());
  }
}

std::optional<std::string> RebuildWork::remembered(const std::string& stage) const {
  const fs::path file = folder_ / (stage + kDone);
  if (!fs::exists(file)) return std::nullopt;
  const std::string text = maps::read_text(file);
  const std::size_t end = text.find('\n');
  if (end == std::string::npos) return std::nullopt;
  // What a disk spoiled is done again.
  if (text.substr(0, end) != maps::sha256_of(text.substr(end + 1))) return std::nullopt;
  return text.substr(end + 1);
}

void RebuildWork::remember(const std::string& stage, const std::string& text) {
  replace_file(folder_ / (stage + kDone), maps::sha256_of(text) + "\n" + text);
}

void RebuildWork::forget(const std::string& stage) {
  fs::remove(folder_ / (stage + kDone));
  sync_folder(folder_);
}

std::uint64_t RebuildWork::bytes() const {
  constexpr std::uint64_t kBlock = 512;
  std::uint64_t bytes = 0;
  std::error_code ignored;
  for (const auto& entry : fs::recursive_directory_iterator(folder_, ignored)) {
    struct stat status {};
    if (::lstat(entry.path().c_str(), &status) == 0)
      bytes += kBlock * static_cast<std::uint64_t>(status.st_blocks);
  }
  return bytes;
}

}  // namespace stillmap::mapping
