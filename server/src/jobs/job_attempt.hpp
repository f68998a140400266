#pragma once

#include "jobs/child_process.hpp"
#include "jobs/job_progress.hpp"

#include <chrono>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace stillmap::server {

/// One run of a job's program.
struct JobAttempt {
  std::vector<std::string> command;
  ProcessLimits limits;
  /// Text is added to it.
  std::filesystem::path log;
  /// Then it is ended.
  std::chrono::seconds most{};
  /// Asked some ten times a second.
  std::function<bool()> is_canceled;
  std::function<bool()> is_stopping;
  std::function<void(const JobProgress&)> on_progress;
  /// Whether it is killed rather than asked to end: asked, it would also end its jobs in a cluster.
  /// Empty: never.
  std::function<bool()> leaves_jobs;
};

/// How it came out.
struct AttemptEnd {
  enum class Kind {
    kDone,      ///< with a map, whatever the gate says of it
    kFailed,    ///< the program said no, or cannot be run: it would say so again
    kCrashed,   ///< a signal that we did not send, or an exit code that is none of the mapper's
    kDiskFull,  ///< it would do well with more room
    kTimedOut,
    kCanceled,
    kStopped,  ///< with the server
  };
  Kind kind = Kind::kDone;
  /// Unless done.
  std::string why;
};

/// How long a program may take to end by itself once it is asked to.
inline constexpr std::chrono::seconds kEndGrace{2};

/// Waits for its end. Whatever the program does is an end and no exception.
[[nodiscard]] AttemptEnd run_attempt(const JobAttempt& attempt);

/// What a short program says.
struct ProgramOutput {
  ProcessEnd end;
  bool timed_out = false;
  /// Of stdout and stderr, the first 64 KiB.
  std::string text;
};
/// @param is_unwanted  asked some ten times a second; then it is killed, as after `most`.
/// @throws std::runtime_error when it cannot be started.
[[nodiscard]] ProgramOutput run_short(const std::vector<std::string>& command,
                                      const ProcessLimits& limits, std::chrono::seconds most,
                                      const std::function<bool()>& is_unwanted);

}  // namespace stillmap::server
