#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace stillmap::mapper {

/// What a program that was run said.
struct ProgramOutput {
  /// 128 and the number of a signal that ended it.
  int exit_code = 0;
  std::string out;
  std::string err;
  /// Nobody waited for its end.
  bool was_left = false;
};

/// What becomes of a program that nobody waits for any more. What one writes that may go on is not
/// kept.
enum class Unawaited : std::uint8_t { kKilled, kGoesOn };

/// Runs one of Slurm's programs, as the PATH has them, in a session of its own, so that Ctrl-C does
/// not reach it, and without the user's variables that change what they do (`SQUEUE_STATES`).
/// @param arguments  program first.
/// @param may_stop   asked ten times a second; from then on nobody waits for it.
/// @throws std::runtime_error when it cannot be started.
[[nodiscard]] ProgramOutput run_slurm_program(const std::vector<std::string>& arguments,
                                              const std::function<bool()>& may_stop,
                                              Unawaited then = Unawaited::kKilled);

}  // namespace stillmap::mapper
