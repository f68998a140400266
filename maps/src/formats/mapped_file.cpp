#include "formats/mapped_file.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <stillmap/maps/error.hpp>

#include <cerrno>
#include <cstring>

namespace stillmap::maps {
namespace {

[[noreturn]] void refuse(const std::filesystem::path& file) {
  throw StorageError(file.string(), std::strerror(errno));
}

struct OpenFile {
  explicit OpenFile(const std::filesystem::path& file)
      : number(::open(file.c_str(), O_RDONLY | O_CLOEXEC)) {}
  ~OpenFile() {
    if (number >= 0) ::close(number);
  }
  OpenFile(const OpenFile&) = delete;
  OpenFile& operator=(const OpenFile&) = delete;
  int number;
};

}  // namespace

MappedFile::MappedFile(const std::filesystem::path& file) {
  const OpenFile opened(file);
  struct stat status {};
  if (opened.number < 0 || ::fstat(opened.number, &status) != 0) refuse(file);
  if (!S_ISREG(status.st_mode)) throw StorageError(file.string(), "not a regular file");
  bytes_ = static_cast<std::size_t>(status.st_size);
  // Nothing can be mapped of an empty file.
  if (bytes_ == 0) return;
  address_ = ::mmap(nullptr, bytes_, PROT_READ, MAP_PRIVATE, opened.number, 0);
  if (address_ == MAP_FAILED) refuse(file);
  ::madvise(address_, bytes_, MADV_SEQUENTIAL);
}

void MappedFile::let_go() const {
  if (address_ != nullptr) ::madvise(address_, bytes_, MADV_DONTNEED);
}

MappedFile::~MappedFile() {
  if (address_ != nullptr) ::munmap(address_, bytes_);
}

}  // namespace stillmap::maps
