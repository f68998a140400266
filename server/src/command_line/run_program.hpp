#pragma once

#include <CLI/CLI.hpp>

#include <atomic>
#include <filesystem>
#include <string>
#include <string_view>

#include "errors/exit_codes.hpp"

namespace stillmap::command_line {

/// What each of `errors/exit_codes.hpp` means, for the end of a help.
inline constexpr const char* kExitCodes =
    "Exit codes: 0 done, 1 failed, 2 wrong usage, 3 disk full, 4 the map of a rebuild did not\n"
    "pass the gate, 130 cancelled.";

/// Parses and runs the chosen subcommand's callback. What goes wrong is one line on stderr,
/// `stillmap: ...`; a mistyped command or option comes with the nearest name.
/// @return the exit code.
[[nodiscard]] int run_program(CLI::App& app, int argc, char** argv);

/// How a person called `stillmap`, such as `build/release/stillmap`: for commands to type next.
[[nodiscard]] const std::string& program_name();

/// For arguments that must be there.
[[nodiscard]] CLI::Validator existing_folder();
[[nodiscard]] CLI::Validator existing_file();
/// A folder, or the name of a new one in a folder that exists.
[[nodiscard]] CLI::Validator folder_or_new();
/// A folder, or a bag's file with what is chosen of it (`maps::Drive::open`).
[[nodiscard]] CLI::Validator existing_drive();
[[nodiscard]] CLI::Validator existing_scan_or_drive();
[[nodiscard]] CLI::Validator existing_path();
/// For files that are written at the end of long work: their folder must be there at its beginning.
[[nodiscard]] CLI::Validator in_existing_folder();

/// Set by SIGINT and SIGTERM once `cancel_on_signals` was called; a second signal ends the program
/// at once.
[[nodiscard]] std::atomic<bool>& cancel_flag();
void cancel_on_signals();

/// What the last line of a cancelled command says: what is left on the disk, and how to go on.
struct WhenCancelled {
  /// Where finished work is kept; empty when a command keeps none.
  std::filesystem::path kept;
  /// Printed when `kept` exists, and when it does not.
  std::string if_kept;
  std::string if_not = "nothing was written; the same command starts anew";
};
/// Holds until the next call. Before the first call the default of `if_not` is printed.
void say_when_cancelled(const WhenCancelled& words);
/// For work that goes on from what is kept at this path.
[[nodiscard]] WhenCancelled goes_on_from(const std::filesystem::path& kept);

/// From now on such a signal ends the program within about a second, with `exit_code::kCancelled`,
/// whatever it does then: for work that can be killed at any instant and goes on later, in stages
/// that do not look at the flag. What is thrown before then ends it as usual.
/// @param fd         where `last_line` goes then; -1 = nowhere.
/// @param last_line  lives as long as the program.
void end_soon_when_cancelled(int fd, std::string_view last_line);

/// Ends the program with a code of its own after its output is written; thrown by a subcommand.
struct ExitCode {
  int value;
};

}  // namespace stillmap::command_line
