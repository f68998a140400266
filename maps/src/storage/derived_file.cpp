#include <stillmap/maps/derived_file.hpp>

#include <stillmap/maps/derived_leftovers.hpp>
#include <stillmap/maps/error.hpp>

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <system_error>
#include <utility>
#include <vector>

#include "storage/synced.hpp"

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

constexpr const char* kPartial = ".partial";

[[noreturn]] void fail(const fs::path& file) {
  throw StorageError(file.string(), std::strerror(errno));
}

int open_locked(const fs::path& partial, const fs::path& target) {
  const int descriptor = ::open(partial.c_str(), O_RDWR | O_CREAT | O_NOFOLLOW | O_CLOEXEC, 0666);
  if (descriptor < 0) fail(partial);
  if (::flock(descriptor, LOCK_EX | LOCK_NB) != 0 || !is_same(descriptor, partial)) {
    ::close(descriptor);
    throw StorageError(target.string(), "being written by another process or thread");
  }
  return descriptor;
}

/// Whether the file of a writer that is gone was removed.
bool remove_dead(const fs::path& partial) {
  const int descriptor = ::open(partial.c_str(), O_RDWR | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
  if (descriptor < 0) return false;
  const bool removed = ::flock(descriptor, LOCK_EX | LOCK_NB) == 0 &&
                       is_same(descriptor, partial) && ::unlink(partial.c_str()) == 0;
  ::close(descriptor);
  return removed;
}

void write_all(int descriptor, std::uint64_t offset, std::span<const std::byte> bytes,
               const fs::path& file) {
  constexpr std::size_t kAtOnce = std::size_t{1} << 24;
  while (!bytes.empty()) {
    const ssize_t written = ::pwrite(descriptor, bytes.data(), std::min(bytes.size(), kAtOnce),
                                     static_cast<off_t>(offset));
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) fail(file);
    offset += static_cast<std::uint64_t>(written);
    bytes = bytes.subspan(static_cast<std::size_t>(written));
  }
}

}  // namespace

DerivedFile::DerivedFile(fs::path target) : target_(std::move(target)) {
  const fs::path folder = target_.parent_path();
  std::error_code error;
  fs::create_directory(folder, error);
  if (error) throw StorageError(folder.string(), error.message());
  // One name for all writers, so that the next one takes up what a killed one left.
  partial_ = folder / ("." + target_.filename().string() + kPartial);
  descriptor_ = open_locked(partial_, target_);
  if (::ftruncate(descriptor_, 0) != 0) {
    const int reason = errno;
    ::unlink(partial_.c_str());
    ::close(descriptor_);
    throw StorageError(partial_.string(), std::strerror(reason));
  }
}

DerivedFile::~DerivedFile() {
  if (!published_) ::unlink(partial_.c_str());
  ::close(descriptor_);
}

void DerivedFile::append(std::span<const std::byte> bytes) {
  write_all(descriptor_, size_, bytes, partial_);
  size_ += bytes.size();
}

void DerivedFile::overwrite(std::uint64_t offset, std::span<const std::byte> bytes) {
  if (offset > size_ || bytes.size() > size_ - offset)
    throw std::invalid_argument(partial_.string() + ": overwritten beyond its end");
  write_all(descriptor_, offset, bytes, partial_);
}

void DerivedFile::read(std::uint64_t offset, std::span<std::byte> to) const {
  while (!to.empty()) {
    const ssize_t got = ::pread(descriptor_, to.data(), to.size(), static_cast<off_t>(offset));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) fail(partial_);
    if (got == 0) throw StorageError(partial_.string(), "shorter than what was written");
    offset += static_cast<std::uint64_t>(got);
    to = to.subspan(static_cast<std::size_t>(got));
  }
}

void DerivedFile::publish() {
  if (::fsync(descriptor_) != 0) fail(partial_);
  if (std::rename(partial_.c_str(), target_.c_str()) != 0) fail(target_);
  published_ = true;
  sync(target_.parent_path());
}

std::size_t clear_derived_leftovers(const fs::path& folder) {
  std::vector<fs::path> found;
  std::error_code error;
  for (fs::directory_iterator at(folder, error); !error && at != fs::directory_iterator();
       at.increment(error)) {
    const fs::path& file = at->path();
    if (file.filename().string().starts_with(".") && file.extension() == kPartial)
      found.push_back(file);
  }
  return static_cast<std::size_t>(std::count_if(found.begin(), found.end(), remove_dead));
}

}  // namespace stillmap::maps
