#include <fcntl.h>
#include <unistd.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/partial_file.hpp>

#include <cerrno>
#include <cstdio>
#include <cstring>

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

void sync(const fs::path& path) {
  const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  const bool synced = descriptor >= 0 && ::fsync(descriptor) == 0;
  const int reason = errno;
  if (descriptor >= 0) ::close(descriptor);
  if (!synced) throw StorageError(path.string(), std::strerror(reason));
}

}  // namespace

PartialFile::PartialFile(const fs::path& target)
    : folder_(target), path_(folder_.path() / folder_.target().filename()) {}

void PartialFile::publish() {
  const fs::path& target = folder_.target();
  sync(path_);
  if (fs::exists(fs::symlink_status(target)))
    throw InputError(target.string(), "an existing path", "a new one");
  if (std::rename(path_.c_str(), target.c_str()) != 0)
    throw StorageError(target.string(), std::strerror(errno));
  sync(target.parent_path());
}

}  // namespace stillmap::maps
