#include "mapper/slurm_program.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <stdexcept>
#include <string_view>
#include <system_error>

namespace stillmap::mapper {
namespace {

constexpr int kLookMs = 100;

std::string words_of(int error) { return std::generic_category().message(error); }

/// What a program writes to one of its descriptors.
class Pipe {
 public:
  Pipe() {
    if (::pipe2(ends_.data(), O_CLOEXEC) != 0)
      throw std::runtime_error("pipe: " + words_of(errno) + "; close other programs");
    ::fcntl(ends_[0], F_SETFL, O_NONBLOCK);
  }
  ~Pipe() {
    for (const int end : ends_)
      if (end >= 0) ::close(end);
  }
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;

  [[nodiscard]] int write_end() const { return ends_[1]; }
  void close_write_end() {
    ::close(ends_[1]);
    ends_[1] = -1;
  }
  void take(std::string& text) {
    std::array<char, 16384> buffer{};
    while (true) {
      const ssize_t got = ::read(ends_[0], buffer.data(), buffer.size());
      if (got < 0 && errno == EINTR) continue;
      if (got <= 0) {
        is_open_ = is_open_ && got < 0 && errno == EAGAIN;
        return;
      }
      text.append(buffer.data(), static_cast<std::size_t>(got));
    }
  }
  /// For `poll`, which passes over -1.
  [[nodiscard]] pollfd watched() const { return {is_open_ ? ends_[0] : -1, POLLIN, 0}; }

 private:
  std::array<int, 2> ends_{-1, -1};
  bool is_open_ = true;
};

/// A user's own habits with Slurm's programs: they would hide jobs from us, send them to another
/// cluster, or change what they are.
bool is_habit(std::string_view variable) {
  constexpr std::array<std::string_view, 7> kHabits{
      "SQUEUE_",      "SCANCEL_",          "SLURM_CLUSTERS=", "SBATCH_CLUSTERS=",
      "SBATCH_WAIT=", "SBATCH_ARRAY_INX=", "SBATCH_ERROR="};
  return std::ranges::any_of(kHabits,
                             [&](std::string_view habit) { return variable.starts_with(habit); });
}

std::vector<char*> environment_without_habits() {
  std::vector<char*> variables;
  for (char** each = environ; *each != nullptr; ++each)
    if (!is_habit(*each)) variables.push_back(*each);
  variables.push_back(nullptr);
  return variables;
}

pid_t spawn(const std::vector<std::string>& arguments, const Pipe& out, const Pipe& err,
            Unawaited then) {
  posix_spawn_file_actions_t actions;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  if (then == Unawaited::kGoesOn) {
    // Pipes would break when this process ends, and end what writes to them.
    ::posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
    ::posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
  } else {
    ::posix_spawn_file_actions_adddup2(&actions, out.write_end(), STDOUT_FILENO);
    ::posix_spawn_file_actions_adddup2(&actions, err.write_end(), STDERR_FILENO);
  }
  ::posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1);
  posix_spawnattr_t attributes;
  ::posix_spawnattr_init(&attributes);
  sigset_t defaults;
  ::sigemptyset(&defaults);
  for (const int signal : {SIGINT, SIGTERM, SIGPIPE}) ::sigaddset(&defaults, signal);
  ::posix_spawnattr_setsigdefault(&attributes, &defaults);
  ::posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSID | POSIX_SPAWN_SETSIGDEF);
  std::vector<char*> words;
  for (const std::string& each : arguments) words.push_back(const_cast<char*>(each.c_str()));
  words.push_back(nullptr);
  const std::vector<char*> variables = environment_without_habits();
  pid_t pid = -1;
  const int error =
      ::posix_spawnp(&pid, words.front(), &actions, &attributes, words.data(), variables.data());
  ::posix_spawnattr_destroy(&attributes);
  ::posix_spawn_file_actions_destroy(&actions);
  if (error != 0)
    throw std::runtime_error(fmt::format(
        "{}: {}; install Slurm's programs (Debian: slurm-client), or build without --executor "
        "slurm",
        arguments.front(), words_of(error)));
  return pid;
}

}  // namespace

ProgramOutput run_slurm_program(const std::vector<std::string>& arguments,
                                const std::function<bool()>& may_stop, Unawaited then) {
  Pipe out;
  Pipe err;
  const pid_t pid = spawn(arguments, out, err, then);
  out.close_write_end();
  err.close_write_end();
  ProgramOutput output;
  int status = 0;
  while (::waitpid(pid, &status, WNOHANG) == 0) {
    std::array<pollfd, 2> pipes{out.watched(), err.watched()};
    ::poll(pipes.data(), pipes.size(), kLookMs);
    out.take(output.out);
    err.take(output.err);
    if (!may_stop()) continue;
    output.was_left = true;
    if (then == Unawaited::kKilled) {
      ::kill(pid, SIGKILL);
      ::waitpid(pid, nullptr, 0);
    }
    return output;
  }
  out.take(output.out);
  err.take(output.err);
  output.exit_code = WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
  return output;
}

}  // namespace stillmap::mapper
