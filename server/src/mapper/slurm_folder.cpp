#include "mapper/slurm_folder.hpp"

#include <stillmap/maps/error.hpp>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <cstring>
#include <fstream>
#include <iterator>
#include <system_error>
#include <thread>
#include <utility>

#include "mapper/slurm_name.hpp"

namespace stillmap::mapper {
namespace {

namespace fs = std::filesystem;

constexpr std::chrono::milliseconds kBetweenTries{100};

/// Its last bytes: logs and lines of progress grow.
std::string end_of(const fs::path& file) {
  constexpr std::streamoff kBytes = 4096;
  std::ifstream stream(file, std::ios::binary | std::ios::ate);
  if (!stream) return {};
  stream.seekg(std::max(std::streamoff{0}, std::streamoff{stream.tellg()} - kBytes));
  return {std::istreambuf_iterator<char>(stream), {}};
}

}  // namespace

std::string file_text(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

std::optional<int> number_in(const fs::path& file) {
  const std::string text = file_text(file);
  int number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  return error == std::errc() ? std::optional(number) : std::nullopt;
}

std::string last_line_in(const fs::path& file) {
  std::string text = end_of(file);
  while (!text.empty() && (text.back() == '\n' || text.back() == '\0')) text.pop_back();
  const std::size_t end = text.rfind('\n');
  return end == std::string::npos ? text : text.substr(end + 1);
}

HeldFolder::HeldFolder(fs::path folder, const mapping::CancelFlag& cancel)
    : folder_(std::move(folder)) {
  for (bool told = false; !try_lock(); told = true) {
    if (cancel) throw mapping::Cancelled();
    if (!told)
      fmt::print(stderr, "stillmap: waits for another process that follows the jobs of {}\n",
                 folder_.string());
    if (std::string plan = file_text(folder_ / kSlurmPlan); !plan.empty())
      plan_of_other_ = std::move(plan);
    std::this_thread::sleep_for(kBetweenTries);
  }
}

HeldFolder::~HeldFolder() {
  if (is_done_) {
    // In one step: nobody takes the rest of it for work that is not done.
    const fs::path removed = folder_.string() + "-done";
    std::error_code ignored;
    fs::remove_all(removed, ignored);
    fs::rename(folder_, removed, ignored);
    fs::remove_all(removed, ignored);
  }
  ::close(descriptor_);
}

bool HeldFolder::try_lock() {
  std::error_code error;
  fs::create_directories(folder_, error);
  if (error) throw maps::StorageError(folder_.string(), error.message());
  const fs::path file = folder_ / "follower.lock";
  descriptor_ = ::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0666);
  const bool is_locked = descriptor_ >= 0 && ::flock(descriptor_, LOCK_EX | LOCK_NB) == 0;
  const int failed = errno;
  // The process before may have removed it since.
  struct stat held {};
  struct stat found {};
  if (is_locked && ::fstat(descriptor_, &held) == 0 && ::stat(file.c_str(), &found) == 0 &&
      held.st_dev == found.st_dev && held.st_ino == found.st_ino)
    return true;
  if (descriptor_ >= 0) ::close(descriptor_);
  if (!is_locked && failed != EWOULDBLOCK && failed != ENOENT && failed != ESTALE)
    throw maps::StorageError(file.string(), std::strerror(failed));
  return false;
}

}  // namespace stillmap::mapper
