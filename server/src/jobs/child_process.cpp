#include "jobs/child_process.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sched.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <stdexcept>
#include <system_error>
#include <utility>

namespace stillmap::server {
namespace {

/// Killed before all others when memory is short.
constexpr const char* kFirstToGo = "1000";

std::string words_of_errno(int error) { return std::generic_category().message(error); }

struct Pipe {
  Descriptor read;
  Descriptor write;
};

Pipe make_pipe() {
  std::array<int, 2> ends{};
  if (::pipe2(ends.data(), O_CLOEXEC) != 0)
    throw std::runtime_error("pipe: " + words_of_errno(errno));
  Pipe pipe{Descriptor(ends[0]), Descriptor(ends[1])};
  ::fcntl(pipe.read.get(), F_SETFL, O_NONBLOCK);
  return pipe;
}

/// All that the new process does between fork and exec, decided before: there, memory and locks of
/// a process with many threads may not be touched.
struct Plan {
  std::vector<char*> arguments;
  int nothing = -1;
  int output = -1;
  int progress = -1;
  pid_t parent = 0;
  int niceness = 0;
  cpu_set_t cores{};
  bool limits_cores = false;
  rlimit memory{};
  bool limits_memory = false;
  sigset_t signals{};
  /// What failed, for the parent, whose memory this is until exec.
  volatile int error = 0;
};

void choose_cores(Plan& plan, int wanted) {
  cpu_set_t allowed;
  CPU_ZERO(&allowed);
  if (wanted <= 0 || ::sched_getaffinity(0, sizeof(allowed), &allowed) != 0) return;
  CPU_ZERO(&plan.cores);
  for (int core = CPU_SETSIZE - 1; core >= 0 && wanted > 0; --core) {
    if (!CPU_ISSET(core, &allowed)) continue;
    CPU_SET(core, &plan.cores);
    --wanted;
  }
  plan.limits_cores = true;
}

void close_others() {
  constexpr int kFirst = ChildProcess::kProgress + 1;
  if (::close_range(kFirst, ~0U, 0) == 0) return;
  // A kernel before 5.9, or a filter.
  constexpr int kMost = 65536;
  for (int fd = kFirst; fd < kMost; ++fd) ::close(fd);
}

/// Only calls that are safe after vfork (signal-safety(7), and plain system calls).
[[noreturn]] void become(Plan& plan) {
  ::setpgid(0, 0);
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  // It may have gone before that.
  if (::getppid() != plan.parent) ::_exit(127);
  ::setpriority(PRIO_PROCESS, 0, plan.niceness);
  if (plan.limits_cores) ::sched_setaffinity(0, sizeof(plan.cores), &plan.cores);
  if (plan.limits_memory) ::setrlimit(RLIMIT_AS, &plan.memory);
  const rlimit none{};
  ::setrlimit(RLIMIT_CORE, &none);
  const int score = ::open("/proc/self/oom_score_adj", O_WRONLY | O_CLOEXEC);
  if (score >= 0) {
    [[maybe_unused]] const ssize_t written = ::write(score, kFirstToGo, 4);
  }
  // Out of the way of the numbers that they go to.
  constexpr int kAbove = 10;
  const int nothing = ::fcntl(plan.nothing, F_DUPFD_CLOEXEC, kAbove);
  const int output = ::fcntl(plan.output, F_DUPFD_CLOEXEC, kAbove);
  const int progress = ::fcntl(plan.progress, F_DUPFD_CLOEXEC, kAbove);
  const bool placed = ::dup2(nothing, 0) >= 0 && ::dup2(output, 1) >= 0 && ::dup2(output, 2) >= 0 &&
                      ::dup2(progress, ChildProcess::kProgress) >= 0;
  for (int number = 1; number < NSIG; ++number) ::signal(number, SIG_DFL);
  ::sigprocmask(SIG_SETMASK, &plan.signals, nullptr);
  if (placed) {
    close_others();
    ::execv(plan.arguments.front(), plan.arguments.data());
  }
  plan.error = errno;
  ::_exit(127);
}

/// In a function of its own: nothing that vfork's second return could find changed.
[[gnu::noinline]] pid_t start(Plan& plan) {
  // NOLINTNEXTLINE(clang-analyzer-security.insecureAPI.vfork): posix_spawn sets no limits
  const pid_t pid = ::vfork();
  if (pid == 0) become(plan);
  return pid;
}

}  // namespace

Descriptor& Descriptor::operator=(Descriptor&& other) noexcept {
  if (this != &other) {
    reset();
    fd_ = other.release();
  }
  return *this;
}

void Descriptor::reset() {
  if (fd_ >= 0) ::close(fd_);
  fd_ = -1;
}

int Descriptor::release() { return std::exchange(fd_, -1); }

std::string ProcessEnd::words() const {
  if (signal != 0) return fmt::format("signal {} ({})", signal, ::strsignal(signal));
  return fmt::format("exit code {}", exit_code);
}

ChildProcess::ChildProcess(const std::vector<std::string>& arguments, const ProcessLimits& limits) {
  Pipe output = make_pipe();
  Pipe progress = make_pipe();
  const Descriptor nothing(::open("/dev/null", O_RDONLY | O_CLOEXEC));
  Plan plan;
  for (const std::string& each : arguments)
    plan.arguments.push_back(const_cast<char*>(each.data()));
  plan.arguments.push_back(nullptr);
  plan.nothing = nothing.get();
  plan.output = output.write.get();
  plan.progress = progress.write.get();
  plan.parent = ::getpid();
  plan.niceness = ::getpriority(PRIO_PROCESS, 0) + limits.nice;
  choose_cores(plan, limits.cores);
  plan.limits_memory = limits.memory_bytes > 0;
  plan.memory.rlim_cur = plan.memory.rlim_max = static_cast<rlim_t>(limits.memory_bytes);
  // Until exec the child runs in our memory: no handler of ours may run there.
  sigset_t all;
  sigset_t before;
  ::sigfillset(&all);
  ::sigemptyset(&plan.signals);
  ::pthread_sigmask(SIG_SETMASK, &all, &before);
  const pid_t pid = start(plan);
  const int fork_error = errno;
  ::pthread_sigmask(SIG_SETMASK, &before, nullptr);
  if (pid < 0) throw std::runtime_error("cannot start a process: " + words_of_errno(fork_error));
  pid_ = pid;
  if (plan.error != 0) {
    ::waitpid(pid_, nullptr, 0);
    throw std::runtime_error(arguments.front() + ": " + words_of_errno(plan.error));
  }
  output_ = std::move(output.read);
  progress_ = std::move(progress.read);
}

ChildProcess::~ChildProcess() {
  if (ended_) return;
  signal(SIGKILL);
  ::waitpid(pid_, nullptr, 0);
}

void ChildProcess::signal(int number) const {
  // Until it was waited for, its number belongs to nobody else.
  if (!ended_) ::kill(-pid_, number);
}

bool ChildProcess::has_ended() {
  if (ended_) return true;
  siginfo_t info{};
  if (::waitid(P_PID, static_cast<id_t>(pid_), &info, WEXITED | WNOHANG | WNOWAIT) != 0 ||
      info.si_pid == 0)
    return false;
  signal(SIGKILL);
  int status = 0;
  ::waitpid(pid_, &status, 0);
  ended_ = true;
  if (WIFSIGNALED(status)) {
    end_.signal = WTERMSIG(status);
  } else {
    end_.exit_code = WEXITSTATUS(status);
  }
  return true;
}

}  // namespace stillmap::server
