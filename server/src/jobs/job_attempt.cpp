#include "jobs/job_attempt.hpp"

#include "errors/exit_codes.hpp"
#include "jobs/job_log.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <poll.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <optional>
#include <stdexcept>
#include <string_view>

namespace stillmap::server {
namespace {

using Clock = std::chrono::steady_clock;
using Kind = AttemptEnd::Kind;

/// How often flags are looked at.
constexpr int kLook_ms = 100;
/// Bytes read of one pipe between two looks: a program that floods its log is cancelled as any.
constexpr std::size_t kMostAtOnce = std::size_t{4} << 20U;

/// Takes what a pipe holds now. @return whether more may come.
template <typename Take>
bool drain(int fd, Take&& take) {
  std::array<char, 16384> buffer{};
  for (std::size_t taken = 0; taken < kMostAtOnce;) {
    const ssize_t got = ::read(fd, buffer.data(), buffer.size());
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return errno == EAGAIN;
    if (got == 0) return false;
    taken += static_cast<std::size_t>(got);
    take(std::string_view(buffer.data(), static_cast<std::size_t>(got)));
  }
  return true;
}

/// Waits for one of the pipes that are open, at most one look.
void wait_for(int output, int progress) {
  std::array<pollfd, 2> pipes = {pollfd{output, POLLIN, 0}, pollfd{progress, POLLIN, 0}};
  ::poll(pipes.data(), pipes.size(), kLook_ms);
}

/// A program on its way to an end that somebody may want earlier.
class Watched {
 public:
  Watched(const JobAttempt& attempt, ChildProcess& child)
      : attempt_(attempt), child_(child), must_end_(Clock::now() + attempt.most) {}

  /// Asks it to end when that is wanted, and kills it when it does not.
  void look() {
    if (!asked_) {
      if (attempt_.is_canceled())
        ask(Kind::kCanceled);
      else if (attempt_.is_stopping())
        ask(Kind::kStopped);
      else if (Clock::now() >= must_end_)
        ask(Kind::kTimedOut);
    } else if (Clock::now() >= kill_at_) {
      child_.signal(SIGKILL);
    }
  }
  [[nodiscard]] std::optional<Kind> asked() const { return asked_; }

 private:
  void ask(Kind kind) {
    asked_ = kind;
    kill_at_ = Clock::now() + kEndGrace;
    child_.signal(attempt_.leaves_jobs && attempt_.leaves_jobs() ? SIGKILL : SIGTERM);
  }

  const JobAttempt& attempt_;
  ChildProcess& child_;
  Clock::time_point must_end_;
  Clock::time_point kill_at_{};
  std::optional<Kind> asked_;
};

/// What would come out the same again; `kCancelled` is somebody's SIGTERM.
bool is_verdict(const ProcessEnd& end) {
  return end.exit_code == exit_code::kFailed || end.exit_code == exit_code::kUsage;
}

AttemptEnd end_of(const ProcessEnd& end, std::optional<Kind> asked, const JobAttempt& attempt,
                  const std::string& said) {
  // The map of a rebuild is there also when it did not pass the gate.
  if (end.signal == 0 &&
      (end.exit_code == exit_code::kSucceeded || end.exit_code == exit_code::kGateNotPassed))
    return {Kind::kDone, {}};
  if (asked == Kind::kTimedOut)
    return {Kind::kTimedOut, fmt::format("took longer than {} s", attempt.most.count())};
  if (asked) return {*asked, *asked == Kind::kCanceled ? "cancelled" : "the server was stopped"};
  if (is_verdict(end)) return {Kind::kFailed, said.empty() ? end.words() : said};
  if (end.exit_code == exit_code::kDiskFull)
    return {Kind::kDiskFull, said.empty() ? end.words() : said};
  return {Kind::kCrashed, end.words() + (said.empty() ? "" : "; its last words: " + said)};
}

}  // namespace

AttemptEnd run_attempt(const JobAttempt& attempt) {
  JobLog log(attempt.log);
  ProgressReader reader;
  try {
    ChildProcess child(attempt.command, attempt.limits);
    Watched watched(attempt, child);
    bool output_open = true;
    bool progress_open = true;
    const auto take_all = [&] {
      output_open = output_open && drain(child.output(), [&](auto text) { log.append(text); });
      bool is_new = false;
      progress_open = progress_open && drain(child.progress(), [&](std::string_view text) {
                        is_new = reader.append(text) || is_new;
                      });
      if (is_new) attempt.on_progress(reader.progress());
    };
    while (!child.has_ended()) {
      wait_for(output_open ? child.output() : -1, progress_open ? child.progress() : -1);
      take_all();
      watched.look();
    }
    // Without waiting for the end of the pipes: somebody else may hold them.
    take_all();
    if (reader.unread() > 0)
      log.append(fmt::format("\n{} lines of progress could not be read\n", reader.unread()));
    const std::string said = reader.failure().empty() ? log.last_line() : reader.failure();
    return end_of(child.end(), watched.asked(), attempt, said);
  } catch (const std::runtime_error& error) {
    log.append(std::string(error.what()) + "\n");
    return {Kind::kFailed, error.what()};
  }
}

ProgramOutput run_short(const std::vector<std::string>& command, const ProcessLimits& limits,
                        std::chrono::seconds most, const std::function<bool()>& is_unwanted) {
  constexpr std::size_t kMostText = std::size_t{64} << 10U;
  ProgramOutput output;
  ChildProcess child(command, limits);
  const Clock::time_point must_end = Clock::now() + most;
  const auto take = [&](std::string_view text) {
    output.text += text.substr(0, kMostText - output.text.size());
  };
  bool open = true;
  while (!child.has_ended()) {
    wait_for(open ? child.output() : -1, -1);
    open = open && drain(child.output(), take);
    static_cast<void>(drain(child.progress(), [](std::string_view) {}));
    output.timed_out = output.timed_out || Clock::now() >= must_end;
    if (output.timed_out || is_unwanted()) child.signal(SIGKILL);
  }
  if (open) static_cast<void>(drain(child.output(), take));
  output.end = child.end();
  return output;
}

}  // namespace stillmap::server
