#include <stillmap/maps/scratch_file.hpp>

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <new>

namespace stillmap::maps {

ScratchFile::ScratchFile(const std::filesystem::path& folder, const std::string& name) {
  std::string pattern = (folder / (name + ".XXXXXX")).string();
  descriptor_ = ::mkstemp(pattern.data());
  if (descriptor_ < 0) throw StorageError(pattern, std::strerror(errno));
  path_ = pattern;
}

ScratchFile::~ScratchFile() {
  ::close(descriptor_);
  remove_name();
}

void ScratchFile::remove_name() {
  if (has_name_) ::unlink(path_.c_str());
  has_name_ = false;
}

std::uint64_t ScratchFile::append(const void* bytes, std::size_t size) {
  for (std::size_t done = 0; done < size;) {
    const ssize_t written = ::pwrite(descriptor_, static_cast<const char*>(bytes) + done,
                                     size - done, static_cast<off_t>(end_ + done));
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) throw StorageError(path_.string(), std::strerror(errno));
    if (written == 0) throw StorageError(path_.string(), "nothing could be written");
    done += static_cast<std::size_t>(written);
  }
  const std::uint64_t begin = end_;
  end_ += size;
  return begin;
}

void* ScratchFile::append_mapped(std::size_t size) {
  // Without room on the disk, a write to the mapped page would end the process.
  int error = EINTR;
  while (error == EINTR) {
    error = ::posix_fallocate(descriptor_, static_cast<off_t>(end_), static_cast<off_t>(size));
  }
  if (error != 0) throw StorageError(path_.string(), std::strerror(error));
  void* begin = ::mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor_,
                       static_cast<off_t>(end_));
  if (begin == MAP_FAILED && errno == ENOMEM) throw std::bad_alloc();
  if (begin == MAP_FAILED) throw StorageError(path_.string(), std::strerror(errno));
  end_ += size;
  return begin;
}

void ScratchFile::read(std::uint64_t offset, void* bytes, std::size_t size) const {
  for (std::size_t done = 0; done < size;) {
    const ssize_t got = ::pread(descriptor_, static_cast<char*>(bytes) + done, size - done,
                                static_cast<off_t>(offset + done));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) throw StorageError(path_.string(), std::strerror(errno));
    if (got == 0)
      throw StorageError(path_.string(),
                         fmt::format("ends at byte {}, expected {}", offset + done, end_));
    done += static_cast<std::size_t>(got);
  }
}

}  // namespace stillmap::maps
