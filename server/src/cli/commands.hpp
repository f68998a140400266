#pragma once

#include <CLI/CLI.hpp>

#include <stillmap/maps/drive_check.hpp>

#include <filesystem>
#include <string_view>
#include <vector>

#include "command_line/command_tree.hpp"

namespace stillmap::cli {

/// Each adds one subcommand, with its options, help and callback.
void add_localize(CLI::App& app);
void add_serve(CLI::App& app);
void add_inspect(CLI::App& app);
void add_delta(CLI::App& app);
void add_mirror(CLI::App& app);
void add_store(CLI::App& app);
void add_keys(CLI::App& app);
/// To the group `keys`.
void add_signing(CLI::App& keys);
void add_audit(CLI::App& app);
void add_completion(CLI::App& app);
/// Names the commands of our other programs, so that the help lists them.
void add_offline_commands(CLI::App& app);

/// @throws maps::InputError when the folder is no store, which opening it would make it.
void require_store(const std::filesystem::path& folder);

/// `stillmap-mapper` or `stillmap-evaluate` for a subcommand that is theirs, else null.
[[nodiscard]] const char* offline_program(std::string_view command);
/// Becomes that program with the same arguments. Returns only by throwing std::runtime_error.
[[noreturn]] void exec_offline(const char* program, char** argv);

/// Commands of those programs. @throws std::runtime_error when one is missing.
[[nodiscard]] std::vector<command_line::CommandEntry> offline_commands();

/// What looks wrong with a drive's poses by the scans' motion: `stillmap-mapper check-poses` in a
/// process of its own. @throws std::runtime_error when it failed; its error is on stderr.
[[nodiscard]] std::vector<maps::DriveFinding> findings_by_motion(
    const std::filesystem::path& drive);

/// `name` beside this program, or at `installed` relative to the folder above it; empty when there
/// is neither.
[[nodiscard]] std::filesystem::path find_beside(const std::filesystem::path& name,
                                                const std::filesystem::path& installed);

}  // namespace stillmap::cli
