#pragma once

#include <CLI/CLI.hpp>

#include <string>

namespace stillmap::mapper {

/// The call of a subcommand of `evaluate` as it was given, options in the order of the help, as a
/// shell reads it.
[[nodiscard]] std::string command_of(const CLI::App& command);

}  // namespace stillmap::mapper
