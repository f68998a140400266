#pragma once

#include <CLI/CLI.hpp>

#include <cstdint>
#include <string>
#include <vector>

namespace stillmap::command_line {

/// What stands behind an option, or in a place of its own.
enum class ValueKind : std::uint8_t { kNone, kText, kNumber, kFile, kFolder };

/// What CLI11 and the validators know of an option's value, for help and completion.
struct OptionValue {
  ValueKind kind = ValueKind::kText;
  /// `FILE`, `NUMBER`; empty for a flag.
  std::string name;
  /// All that may be given; empty when anything may.
  std::vector<std::string> choices;
  /// `2 to 1000`; empty without bounds.
  std::string bounds;
};
[[nodiscard]] OptionValue value_of(const CLI::Option& option);

/// One of these words. The message of another one names them all, and the nearest.
[[nodiscard]] CLI::Validator one_of(std::vector<std::string> choices);

}  // namespace stillmap::command_line
