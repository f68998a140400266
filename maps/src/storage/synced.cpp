#include "storage/synced.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <stillmap/maps/error.hpp>

#include <cerrno>
#include <cstring>

namespace stillmap::maps {

void sync(const std::filesystem::path& path) {
  const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  const bool synced = descriptor >= 0 && ::fsync(descriptor) == 0;
  const int reason = errno;
  if (descriptor >= 0) ::close(descriptor);
  if (!synced) throw StorageError(path.string(), std::strerror(reason));
}

bool is_same(int descriptor, const std::filesystem::path& path) {
  struct stat opened {};
  struct stat named {};
  return ::fstat(descriptor, &opened) == 0 && ::stat(path.c_str(), &named) == 0 &&
         opened.st_dev == named.st_dev && opened.st_ino == named.st_ino;
}

}  // namespace stillmap::maps
