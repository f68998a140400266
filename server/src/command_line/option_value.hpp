#pragma once

#include <CLI/CLI.hpp>

#include <cstdint>
#include <string>
#include <vector>

namespace stillmap::command_line {

/// What an option or an argument takes.
enum class ValueKind : std::uint8_t { kNone, kText, kNumber, kFile, kFolder };

/// The value of an option or an argument, for help and completion.
struct OptionValue {
  ValueKind kind = ValueKind::kText;
  /// `FILE`, `NUMBER`; empty for a flag.
  std::string name;
  /// All allowed values; empty without such a list.
  std::vector<std::string> choices;
  /// `2 to 1000`; empty without bounds.
  std::string bounds;
};
[[nodiscard]] OptionValue value_of(const CLI::Option& option);

/// Without a value; one may come behind `=`.
[[nodiscard]] bool is_flag(const CLI::Option& option);

/// Allows these words only. The message for another word names all of them, and the nearest.
[[nodiscard]] CLI::Validator one_of(std::vector<std::string> choices);

}  // namespace stillmap::command_line
