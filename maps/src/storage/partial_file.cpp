#include <fcntl.h>
#include <unistd.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/partial_file.hpp>

#include <cerrno>
#include <cstdio>
#include <cstring>

#include "storage/synced.hpp"

namespace stillmap::maps {
namespace fs = std::filesystem;

PartialFile::PartialFile(const fs::path& target)
    : folder_(target), path_(folder_.path() / folder_.target().filename()) {}

void PartialFile::publish() {
  const fs::path& target = folder_.target();
  sync(path_);
  if (fs::exists(fs::symlink_status(target)))
    throw InputError(target.string(), "an existing path",
                     "a new one: give another name, or remove it");
  if (std::rename(path_.c_str(), target.c_str()) != 0)
    throw StorageError(target.string(), std::strerror(errno));
  sync(target.parent_path());
}

}  // namespace stillmap::maps
