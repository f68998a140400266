#include "units/unit_lock.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <system_error>

namespace stillmap::mapping {

UnitLock::UnitLock(const std::filesystem::path& folder, const std::string& unit) {
  std::string name = unit;
  std::ranges::replace(name, ':', '_');
  scratch_ = folder / ("scratch_" + name);
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw maps::StorageError(folder.string(), error.message());
  const std::filesystem::path file = folder / (name + ".lock");
  descriptor_ = ::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0666);
  if (descriptor_ < 0) throw maps::StorageError(file.string(), std::strerror(errno));
  if (::flock(descriptor_, LOCK_EX | LOCK_NB) != 0) {
    const int failed = errno;
    ::close(descriptor_);
    if (failed != EWOULDBLOCK) throw maps::StorageError(file.string(), std::strerror(failed));
    throw maps::InputError(file.string(),
                           fmt::format("the unit '{}' being done by another process", unit),
                           "one process a unit: wait until that one has ended");
  }
  // What a killed process left.
  std::filesystem::remove_all(scratch_, error);
  std::filesystem::create_directory(scratch_, error);
  if (error) {
    ::close(descriptor_);
    throw maps::StorageError(scratch_.string(), error.message());
  }
}

UnitLock::~UnitLock() {
  std::error_code ignored;
  std::filesystem::remove_all(scratch_, ignored);
  ::close(descriptor_);
}

}  // namespace stillmap::mapping
