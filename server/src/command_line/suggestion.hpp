#pragma once

#include <CLI/CLI.hpp>

#include <span>
#include <string>
#include <vector>

namespace stillmap::command_line {

/// Checks the names of commands and options before CLI11 does, which would name a missing option
/// instead of the mistyped one. @throws std::invalid_argument naming the word and the nearest name.
void require_known_words(const CLI::App& app, std::span<char* const> words);

/// `stillmap store add`: a command as it is typed.
[[nodiscard]] std::string full_name(const CLI::App& command);

/// The commands below one that its help lists.
[[nodiscard]] std::vector<const CLI::App*> listed_commands(const CLI::App& app);

}  // namespace stillmap::command_line
