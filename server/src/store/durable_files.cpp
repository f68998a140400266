#include "store/durable_files.hpp"

#include <stillmap/maps/error.hpp>
#include "store/disk_full.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <system_error>
#include <utility>
#include <vector>

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;
using Kind = DiskCall::Kind;

std::int64_t result_of(int result) { return result < 0 ? -errno : 0; }

[[noreturn]] void fail(const fs::path& path, std::int64_t result) {
  if (result == -ENOSPC || result == -EDQUOT)
    throw DiskFull(path.string(), std::strerror(static_cast<int>(-result)));
  throw maps::StorageError(path.string(), std::strerror(static_cast<int>(-result)));
}

void pass(DiskCalls& calls, const DiskCall& call, const DiskCalls::Perform& perform) {
  const std::int64_t result = calls.pass(call, perform);
  if (result < 0) fail(call.path, result);
}

std::int64_t sync_path(const fs::path& path, int kind) {
  const int descriptor = ::open(path.c_str(), O_RDONLY | O_NOFOLLOW | O_CLOEXEC | kind);
  if (descriptor < 0) return -errno;
  const std::int64_t result = result_of(::fsync(descriptor));
  ::close(descriptor);
  return result;
}

}  // namespace

DiskCalls& DiskCalls::real() {
  static DiskCalls calls;
  return calls;
}

DurableFiles::NewFile::NewFile(DiskCalls& calls, fs::path path, int descriptor)
    : calls_(&calls), path_(std::move(path)), descriptor_(descriptor) {}

DurableFiles::NewFile::NewFile(NewFile&& other) noexcept
    : calls_(other.calls_),
      path_(std::move(other.path_)),
      descriptor_(std::exchange(other.descriptor_, -1)),
      size_(other.size_) {}

DurableFiles::NewFile::~NewFile() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

void DurableFiles::NewFile::append(std::string_view bytes) {
  while (!bytes.empty()) {
    const DiskCall call{.kind = Kind::kWrite, .path = path_, .offset = size_, .bytes = bytes};
    const std::int64_t written = calls_->pass(call, [&](std::size_t count) -> std::int64_t {
      const ssize_t done =
          ::pwrite(descriptor_, bytes.data(), count, static_cast<off_t>(call.offset));
      return done < 0 ? -errno : done;
    });
    if (written == -EINTR) continue;
    // No progress at all would go on for ever.
    if (written <= 0) fail(path_, written == 0 ? -EIO : written);
    size_ += static_cast<std::uint64_t>(written);
    bytes.remove_prefix(static_cast<std::size_t>(written));
  }
}

void DurableFiles::NewFile::allocate(std::uint64_t bytes) {
  pass(*calls_, {.kind = Kind::kAllocate, .path = path_, .offset = bytes},
       [&](std::size_t) -> std::int64_t {
         return -::posix_fallocate(descriptor_, 0, static_cast<off_t>(bytes));
       });
  size_ = bytes;
}

void DurableFiles::NewFile::finish() {
  pass(*calls_, {.kind = Kind::kSyncFile, .path = path_},
       [&](std::size_t) { return result_of(::fsync(descriptor_)); });
  close();
}

void DurableFiles::NewFile::close() {
  const int descriptor = std::exchange(descriptor_, -1);
  // Network file systems may say only here that the quota is used up.
  if (::close(descriptor) != 0) fail(path_, -errno);
}

DurableFiles::NewFile DurableFiles::create(const fs::path& file, unsigned mode) const {
  int descriptor = -1;
  pass(*calls_, {.kind = Kind::kCreateFile, .path = file}, [&](std::size_t) -> std::int64_t {
    descriptor = ::open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, mode);
    return descriptor < 0 ? -errno : 0;
  });
  return {*calls_, file, descriptor};
}

void DurableFiles::sync_file(const fs::path& file) const {
  pass(*calls_, {.kind = Kind::kSyncFile, .path = file},
       [&](std::size_t) { return sync_path(file, 0); });
}

bool DurableFiles::make_folder(const fs::path& folder, unsigned mode) const {
  const std::int64_t result =
      calls_->pass({.kind = Kind::kMakeFolder, .path = folder},
                   [&](std::size_t) { return result_of(::mkdir(folder.c_str(), mode)); });
  if (result == -EEXIST) {
    std::error_code error;
    if (fs::is_directory(folder, error)) return false;
  }
  if (result < 0) fail(folder, result);
  return true;
}

void DurableFiles::sync_folder(const fs::path& folder) const {
  pass(*calls_, {.kind = Kind::kSyncFolder, .path = folder},
       [&](std::size_t) { return sync_path(folder, O_DIRECTORY); });
}

void DurableFiles::rename(const fs::path& from, const fs::path& to) const {
  pass(*calls_, {.kind = Kind::kRename, .path = from, .to = to},
       [&](std::size_t) { return result_of(std::rename(from.c_str(), to.c_str())); });
}

void DurableFiles::exchange(const fs::path& one, const fs::path& other) const {
  const std::int64_t result =
      calls_->pass({.kind = Kind::kExchange, .path = one, .to = other}, [&](std::size_t) {
        return result_of(
            ::renameat2(AT_FDCWD, one.c_str(), AT_FDCWD, other.c_str(), RENAME_EXCHANGE));
      });
  if (result == -EINVAL)
    throw maps::StorageError(other.string(), "its file system cannot exchange it for another");
  if (result < 0) fail(other, result);
}

bool DurableFiles::link(const fs::path& from, const fs::path& to) const {
  const std::int64_t result =
      calls_->pass({.kind = Kind::kLink, .path = from, .to = to}, [&](std::size_t) {
        return result_of(::linkat(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), 0));
      });
  for (const int no_link : {EXDEV, EPERM, EMLINK, EOPNOTSUPP})
    if (result == -no_link) return false;
  if (result < 0) fail(from, result);
  return true;
}

void DurableFiles::remove_file(const fs::path& file) const {
  pass(*calls_, {.kind = Kind::kRemoveFile, .path = file},
       [&](std::size_t) { return result_of(::unlink(file.c_str())); });
}

void DurableFiles::remove_folder(const fs::path& folder) const {
  pass(*calls_, {.kind = Kind::kRemoveFolder, .path = folder},
       [&](std::size_t) { return result_of(::rmdir(folder.c_str())); });
}

void DurableFiles::remove_tree(const fs::path& folder) const {
  std::vector<fs::directory_entry> entries;
  std::error_code error;
  fs::directory_iterator at(folder, error);
  for (; !error && at != fs::directory_iterator(); at.increment(error)) entries.push_back(*at);
  if (error) throw maps::StorageError(folder.string(), error.message());
  for (const fs::directory_entry& entry : entries) {
    if (entry.symlink_status().type() == fs::file_type::directory) {
      remove_tree(entry.path());
      continue;
    }
    remove_file(entry.path());
  }
  remove_folder(folder);
}

}  // namespace stillmap::server
