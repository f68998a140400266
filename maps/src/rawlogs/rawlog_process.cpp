#include "rawlogs/rawlog_process.hpp"

#include <stillmap/maps/error.hpp>

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <spawn.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <system_error>
#include <utility>
#include <vector>

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

constexpr int kPatienceMs = 60'000;
constexpr int kLookAgainMs = 200;
/// Of bytes of records to bytes of the (mostly packed) rawlog.
constexpr std::uint64_t kMostGrowth = 100;
constexpr std::uint64_t kAllowedAnyway = 64U << 20U;

std::string reason() { return std::generic_category().message(errno); }

class Descriptor {
 public:
  explicit Descriptor(int descriptor) : descriptor_(descriptor) {}
  ~Descriptor() { close(); }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  [[nodiscard]] int get() const { return descriptor_; }
  void close() {
    if (descriptor_ >= 0) ::close(descriptor_);
    descriptor_ = -1;
  }

 private:
  int descriptor_;
};

/// `stillmap-rawlog`, killed if nobody waited for its end.
class Process {
 public:
  Process(const fs::path& program, std::vector<std::string> words, int input, int output) {
    posix_spawn_file_actions_t actions;
    ::posix_spawn_file_actions_init(&actions);
    ::posix_spawn_file_actions_adddup2(&actions, input, STDIN_FILENO);
    ::posix_spawn_file_actions_adddup2(&actions, output, STDOUT_FILENO);
    ::posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
    std::string name = program.string();
    std::vector<char*> arguments{name.data()};
    for (std::string& word : words) arguments.push_back(word.data());
    arguments.push_back(nullptr);
    // What the caller's environment says is nothing to it, above all not where MRPT's files lie.
    std::array<char*, 1> environment{nullptr};
    const int error =
        ::posix_spawn(&pid_, name.c_str(), &actions, nullptr, arguments.data(), environment.data());
    ::posix_spawn_file_actions_destroy(&actions);
    if (error != 0) throw StorageError(name, std::generic_category().message(error));
  }
  ~Process() {
    if (!ended_) (void)end(true);
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  /// @return how it ended, where that was not of itself.
  std::string end(bool now) {
    if (now) ::kill(pid_, SIGKILL);
    int status = 0;
    while (::waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
    }
    ended_ = true;
    if (now) return "was killed";
    if (WIFSIGNALED(status)) {
      const int signal = WTERMSIG(status);
      return fmt::format("was ended by signal {} ({})", signal, ::strsignal(signal));
    }
    if (WEXITSTATUS(status) == 0) return {};
    return fmt::format("ended with exit code {}", WEXITSTATUS(status));
  }

 private:
  pid_t pid_ = -1;
  bool ended_ = false;
};

}  // namespace

UnnamedFile::UnnamedFile() : folder_(fs::temp_directory_path().string()) {
  std::string name = folder_ + "/stillmap_rawlog_XXXXXX";
  descriptor_ = ::mkostemp(name.data(), O_CLOEXEC);
  if (descriptor_ < 0) throw StorageError(name, reason());
  ::unlink(name.c_str());
}

UnnamedFile::~UnnamedFile() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

bool UnnamedFile::read(std::uint64_t offset, void* bytes, std::size_t size) const {
  auto* to = static_cast<char*>(bytes);
  while (size > 0) {
    const ssize_t count = ::pread(descriptor_, to, size, static_cast<off_t>(offset));
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) throw StorageError(folder_, reason());
    if (count == 0) return false;
    to += count;
    offset += static_cast<std::uint64_t>(count);
    size -= static_cast<std::size_t>(count);
  }
  return true;
}

void UnnamedFile::append(const void* bytes, std::size_t size) {
  const auto* from = static_cast<const char*>(bytes);
  while (size > 0) {
    const ssize_t count = ::pwrite(descriptor_, from, size, static_cast<off_t>(size_));
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) throw StorageError(folder_, reason());
    from += count;
    size_ += static_cast<std::uint64_t>(count);
    size -= static_cast<std::size_t>(count);
  }
}

fs::path rawlog_program() {
  std::error_code error;
  const fs::path folder = fs::canonical("/proc/self/exe", error).parent_path();
  for (const fs::path& candidate :
       {folder / "stillmap-rawlog", folder.parent_path() / "libexec/stillmap/stillmap-rawlog"})
    if (!error && fs::exists(candidate)) return candidate;
  return {};
}

std::string read_rawlog(const fs::path& file, UnnamedFile& records) {
  const fs::path program = rawlog_program();
  if (program.empty())
    throw InputError(file.string(), "an MRPT rawlog, and no stillmap-rawlog to read it",
                     "that program (built where MRPT's libmrpt-obs-dev and libmrpt-maps-dev are), "
                     "or the rawlog's clouds as PCD, KITTI .bin or MCAP");
  const Descriptor input(::open(file.c_str(), O_RDONLY | O_CLOEXEC));
  struct stat status {};
  if (input.get() < 0 || ::fstat(input.get(), &status) != 0)
    throw StorageError(file.string(), reason());
  std::array<int, 2> ends{};
  if (::pipe2(ends.data(), O_CLOEXEC) != 0) throw StorageError(file.string(), reason());
  const Descriptor from(ends[0]);
  Descriptor to(ends[1]);
  Process reader(program, {}, input.get(), to.get());
  to.close();
  const std::uint64_t most =
      kMostGrowth * static_cast<std::uint64_t>(status.st_size) + kAllowedAnyway;
  std::vector<char> buffer(1U << 18U);
  while (true) {
    pollfd ready{from.get(), POLLIN, 0};
    const int count = ::poll(&ready, 1, kPatienceMs);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) {
      (void)reader.end(true);
      return "nothing was heard of its reader for a minute";
    }
    const ssize_t bytes = ::read(from.get(), buffer.data(), buffer.size());
    if (bytes < 0 && errno == EINTR) continue;
    if (bytes <= 0) {
      const std::string how = reader.end(false);
      return how.empty() ? how : "its reader " + how;
    }
    records.append(buffer.data(), static_cast<std::size_t>(bytes));
    if (records.size() > most)
      throw InputError(file.string(), fmt::format("more than {} times its size", kMostGrowth),
                       "a rawlog of clouds");
  }
}

bool write_simplemap(const fs::path& program, const UnnamedFile& records, const fs::path& file,
                     const std::function<bool()>& go_on) {
  std::array<int, 2> ends{};
  if (::pipe2(ends.data(), O_CLOEXEC) != 0) throw StorageError(file.string(), reason());
  const Descriptor from(ends[0]);
  Descriptor to(ends[1]);
  Process writer(program, {"--write-simplemap", file.string()}, records.descriptor(), to.get());
  to.close();
  std::string words;
  std::array<char, 4096> buffer{};
  while (true) {
    pollfd ready{from.get(), POLLIN, 0};
    const int count = ::poll(&ready, 1, kLookAgainMs);
    const bool interrupted = count < 0 && errno == EINTR;
    if (count < 0 && !interrupted) throw StorageError(file.string(), reason());
    if (!go_on()) return false;
    if (count <= 0) continue;
    const ssize_t bytes = ::read(from.get(), buffer.data(), buffer.size());
    if (bytes < 0 && errno == EINTR) continue;
    if (bytes < 0) throw StorageError(file.string(), reason());
    if (bytes == 0) break;
    words.append(buffer.data(), static_cast<std::size_t>(bytes));
  }
  const std::string how = writer.end(false);
  // What ended it may have been meant for both.
  if (!go_on()) return false;
  if (!how.empty())
    throw StorageError(file.string(), words.empty() ? "its writer " + how : std::move(words));
  return true;
}

}  // namespace stillmap::maps
