#include "index/index_file.hpp"

#include "index/crc32c.hpp"
#include "index/index_format.hpp"

#include <stillmap/maps/error.hpp>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <string>
#include <system_error>

namespace stillmap::localization {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void fail(const fs::path& file) {
  throw maps::StorageError(file.string(), std::strerror(errno));
}

/// A descriptor that is closed at the end of its scope.
class Descriptor {
 public:
  Descriptor(const fs::path& file, int flags)
      : number_(::open(file.c_str(), flags | O_CLOEXEC, 0666)) {
    if (number_ < 0) fail(file);
  }
  ~Descriptor() { ::close(number_); }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  [[nodiscard]] int number() const { return number_; }

 private:
  int number_;
};

/// Whether the open file is still the one of that name: another writer may have published it
/// between our open and our lock.
bool is_same(const Descriptor& descriptor, const fs::path& file) {
  struct stat opened {};
  struct stat named {};
  return ::fstat(descriptor.number(), &opened) == 0 && ::stat(file.c_str(), &named) == 0 &&
         opened.st_dev == named.st_dev && opened.st_ino == named.st_ino;
}

void write_all(const Descriptor& descriptor, const fs::path& file,
               std::span<const std::byte> bytes) {
  constexpr std::size_t kAtOnce = std::size_t{1} << 24;
  while (!bytes.empty()) {
    const ssize_t written =
        ::write(descriptor.number(), bytes.data(), std::min(bytes.size(), kAtOnce));
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) fail(file);
    bytes = bytes.subspan(static_cast<std::size_t>(written));
  }
}

}  // namespace

MappedFile::MappedFile(const fs::path& file) {
  const Descriptor descriptor(file, O_RDONLY);
  struct stat status {};
  if (::fstat(descriptor.number(), &status) != 0) fail(file);
  if (!S_ISREG(status.st_mode) || status.st_size <= 0) {
    throw maps::InputError(file.string(), "an empty or no regular file", "a map index");
  }
  size_ = static_cast<std::size_t>(status.st_size);
  void* address = ::mmap(nullptr, size_, PROT_READ, MAP_SHARED, descriptor.number(), 0);
  if (address == MAP_FAILED) fail(file);
  address_ = static_cast<const std::byte*>(address);
}

MappedFile::~MappedFile() { ::munmap(const_cast<std::byte*>(address_), size_); }

fs::path index_file_of(const fs::path& package, const MapIndexOptions& options) {
  const std::string text =
      fmt::format("{:a} {} {}", options.finest_voxel_m, options.levels, options.min_points);
  return package / "index" /
         fmt::format("{}-{:08x}.idx", index_format::kFormat,
                     crc32c(std::as_bytes(std::span(text.data(), text.size()))));
}

void publish_file(const fs::path& file, std::span<const std::byte> bytes) {
  const fs::path folder = file.parent_path();
  std::error_code error;
  fs::create_directory(folder, error);
  if (error) throw maps::StorageError(folder.string(), error.message());
  // One name for all writers, so that the next one takes up what a killed one left.
  const fs::path partial = folder / ("." + file.filename().string() + ".partial");
  const Descriptor descriptor(partial, O_RDWR | O_CREAT | O_NOFOLLOW);
  if (::flock(descriptor.number(), LOCK_EX | LOCK_NB) != 0 || !is_same(descriptor, partial)) {
    throw maps::StorageError(file.string(), "being written by another process or thread");
  }
  try {
    if (::ftruncate(descriptor.number(), 0) != 0) fail(partial);
    write_all(descriptor, partial, bytes);
    if (::fsync(descriptor.number()) != 0) fail(partial);
    if (std::rename(partial.c_str(), file.c_str()) != 0) fail(file);
  } catch (...) {
    ::unlink(partial.c_str());
    throw;
  }
  const Descriptor opened_folder(folder, O_RDONLY | O_DIRECTORY);
  if (::fsync(opened_folder.number()) != 0) fail(folder);
}

}  // namespace stillmap::localization
