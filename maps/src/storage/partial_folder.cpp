#include <stillmap/maps/error.hpp>
#include <stillmap/maps/hidden_beside.hpp>
#include <stillmap/maps/partial_folder.hpp>

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <string>
#include <system_error>
#include <utility>

#include "storage/synced.hpp"

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

fs::path without_trailing_slash(const fs::path& path) {
  const fs::path whole = fs::absolute(path).lexically_normal();
  return whole.has_filename() ? whole : whole.parent_path();
}

/// Makes the folder if needed and locks it. The lock is on the folder itself, so it ends with the
/// process.
int open_locked(const fs::path& path) {
  for (int attempt = 0; attempt < 10; ++attempt) {
    if (::mkdir(path.c_str(), 0777) != 0 && errno != EEXIST) {
      throw StorageError(path.parent_path().string() + " cannot be written", std::strerror(errno));
    }
    const int descriptor = ::open(path.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (descriptor < 0) {
      if (errno == ENOENT) continue;
      throw StorageError(path.string(), std::strerror(errno));
    }
    if (::flock(descriptor, LOCK_EX | LOCK_NB) == 0) {
      if (is_same(descriptor, path)) return descriptor;
    } else if (errno == EWOULDBLOCK) {
      ::close(descriptor);
      throw InputError(path.string(), "a folder that another process is filling",
                       "none: wait for that process, or give another name");
    } else {
      const int reason = errno;
      ::close(descriptor);
      throw StorageError(path.string(), std::strerror(reason));
    }
    ::close(descriptor);
  }
  throw StorageError(path.string(), "cannot be locked");
}

/// A survivor is a folder, never a link to one.
void remove_all_but(const fs::path& folder, const std::string& survivor, std::error_code& error) {
  fs::directory_iterator left(folder, error);
  while (!error && left != fs::directory_iterator()) {
    std::error_code ignored;
    const bool survives = left->path().filename() == survivor &&
                          left->symlink_status(ignored).type() == fs::file_type::directory;
    if (!survives) fs::remove_all(left->path(), error);
    if (!error) left.increment(error);
  }
}

void refuse_existing(const fs::path& target) {
  std::error_code error;
  const fs::file_type type = fs::symlink_status(target, error).type();
  if (type == fs::file_type::not_found) return;
  if (type == fs::file_type::none) throw StorageError(target.string(), error.message());
  throw InputError(target.string(), "an existing path",
                   "a new one: give another name, or remove it");
}

}  // namespace

PartialFolder::PartialFolder(const fs::path& target, std::string survivor)
    : target_(without_trailing_slash(target)), survivor_(std::move(survivor)) {
  refuse_existing(target_);
  path_ = hidden_beside(target_, ".partial");
  lock_ = open_locked(path_);
  try {
    // The one who held the lock before us may have published in between.
    refuse_existing(target_);
    std::error_code error;
    remove_all_but(path_, survivor_, error);
    if (error) throw StorageError(path_.string(), error.message());
  } catch (const fs::filesystem_error& error) {
    ::close(lock_);
    throw StorageError(path_.string(), error.code().message());
  } catch (...) {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
    ::close(lock_);
    throw;
  }
}

PartialFolder::~PartialFolder() {
  if (!published_) {
    std::error_code ignored;
    remove_all_but(path_, survivor_, ignored);
    // Only where nothing survived.
    fs::remove(path_, ignored);
  }
  ::close(lock_);
}

void PartialFolder::publish() {
  for (auto entry = fs::recursive_directory_iterator(path_); entry != fs::end(entry); ++entry) {
    if (entry.depth() == 0 && entry->path().filename() == survivor_)
      entry.disable_recursion_pending();
    else
      sync(entry->path());
  }
  refuse_existing(target_);
  // As late as can be: a kill before it loses nothing.
  if (!survivor_.empty()) fs::remove_all(path_ / survivor_);
  sync(path_);
  if (std::rename(path_.c_str(), target_.c_str()) != 0) {
    throw StorageError(target_.string(), std::strerror(errno));
  }
  published_ = true;
  sync(target_.parent_path());
}

}  // namespace stillmap::maps
