#pragma once

#include <CLI/CLI.hpp>

#include <string>

namespace stillmap::mapper {

/// The call of a subcommand of `evaluate` that was given, quoted for a shell, options in the order
/// of the help.
[[nodiscard]] std::string command_of(const CLI::App& command);

}  // namespace stillmap::mapper
