#include <stillmap/maps/mapped_file.hpp>

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

MappedFile::MappedFile(const std::filesystem::path& file, Reading reading) {
  const OpenFile opened(file);
  struct stat status {};
  if (opened.number < 0 || ::fstat(opened.number, &status) != 0) refuse(file);
  if (!S_ISREG(status.st_mode)) throw StorageError(file.string(), "not a regular file");
  size_ = static_cast<std::size_t>(status.st_size);
  // An empty file cannot be mapped.
  if (size_ == 0) return;
  void* address = ::mmap(nullptr, size_, PROT_READ, MAP_SHARED, opened.number, 0);
  if (address == MAP_FAILED) refuse(file);
  address_ = address;
  if (reading == Reading::kInOrder) ::madvise(address_, size_, MADV_SEQUENTIAL);
}

void MappedFile::release_pages() const {
  if (address_ != nullptr) ::madvise(address_, size_, MADV_DONTNEED);
}

MappedFile::~MappedFile() {
  if (address_ != nullptr) ::munmap(address_, size_);
}

}  // namespace stillmap::maps
