#include "index/index_file.hpp"

#include "index/index_format.hpp"

#include <stillmap/maps/crc32c.hpp>
#include <stillmap/maps/derived_file.hpp>
#include <stillmap/maps/error.hpp>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <string>

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
                     maps::crc32c(std::as_bytes(std::span(text.data(), text.size()))));
}

void publish_file(const fs::path& file, std::span<const std::byte> bytes) {
  maps::DerivedFile derived(file);
  derived.append(bytes);
  derived.publish();
}

}  // namespace stillmap::localization
