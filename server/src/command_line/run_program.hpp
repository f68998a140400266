#pragma once

#include <CLI/CLI.hpp>

#include <atomic>
#include <string>
#include <string_view>

namespace stillmap::command_line {

inline constexpr int kSucceeded = 0;
inline constexpr int kFailed = 1;
inline constexpr int kUsage = 2;
/// Failed for want of room on the disk: with more of it, the same may do well.
inline constexpr int kDiskFull = 3;
inline constexpr int kCancelled = 130;

/// Parses and runs the chosen subcommand's callback. What goes wrong is one line on stderr,
/// `stillmap: ...`.
/// @return the exit code.
[[nodiscard]] int run_program(CLI::App& app, int argc, char** argv);

/// How a person called `stillmap`, such as `build/release/stillmap`: for commands to type next.
[[nodiscard]] const std::string& program_name();

/// For arguments that must be there; say what was found in the words of every other error.
[[nodiscard]] CLI::Validator existing_folder();
[[nodiscard]] CLI::Validator existing_file();
/// A folder, or the name of a new one in a folder that exists.
[[nodiscard]] CLI::Validator folder_or_new();
/// A folder, or a bag's file with what is chosen of it (`maps::Drive::open`).
[[nodiscard]] CLI::Validator existing_drive();
[[nodiscard]] CLI::Validator existing_path();
/// For files that are written at the end of long work: their folder must be there at its beginning.
[[nodiscard]] CLI::Validator in_existing_folder();

/// Set by SIGINT and SIGTERM once `cancel_on_signals` was called; a second signal ends the program
/// at once.
[[nodiscard]] std::atomic<bool>& cancel_flag();
void cancel_on_signals();
/// From now on such a signal ends the program within about a second, with `kCancelled`, whatever it
/// does then: for work that can be killed at any instant and goes on later, in stages that do not
/// look at the flag. What is thrown before then ends it as usual.
/// @param fd         where `last_line` goes then; -1 = nowhere.
/// @param last_line  lives as long as the program.
void end_soon_when_cancelled(int fd, std::string_view last_line);

/// Ends the program with a code of its own after its output is written; thrown by a subcommand.
struct ExitCode {
  int value;
};

}  // namespace stillmap::command_line
