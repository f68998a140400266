#pragma once

#include <CLI/CLI.hpp>

#include <array>
#include <string>

namespace stillmap::mapper {

/// The call of a subcommand of `evaluate` that was given, quoted for a shell, options in the order
/// of the help.
[[nodiscard]] std::string command_of(const CLI::App& command);

/// `METRES,DEGREES`. @throws std::invalid_argument naming the option and the text.
[[nodiscard]] std::array<double, 2> metres_and_degrees(const std::string& option,
                                                       const std::string& text);

}  // namespace stillmap::mapper
