#pragma once

#include <CLI/CLI.hpp>

#include <string>
#include <vector>

#include "command_line/option_value.hpp"

namespace stillmap::command_line {

/// A command with its options and arguments, for completion.
struct CommandEntry {
  struct Value {
    ValueKind kind = ValueKind::kText;
    std::vector<std::string> choices;
  };
  struct Option {
    /// With their dashes.
    std::vector<std::string> names;
    std::string description;
    Value value;
    /// Its value comes behind `=` or not at all.
    bool only_assigned = false;
  };
  /// `stillmap store add`.
  std::string name;
  std::string description;
  std::vector<Option> options;
  std::vector<Value> arguments;
};

/// The program and all commands that its help lists, depth first.
[[nodiscard]] std::vector<CommandEntry> command_tree(const CLI::App& app);

/// How one program passes its tree to another. @throws std::runtime_error for other text.
[[nodiscard]] std::string to_json(const std::vector<CommandEntry>& tree);
[[nodiscard]] std::vector<CommandEntry> command_tree_from(const std::string& json);

/// With this word alone, a program prints its tree. No help lists it.
inline constexpr const char* kPrintsCommandTree = "command-tree";

/// A script for a shell that completes commands, options and their values.
[[nodiscard]] std::string bash_completion(const std::vector<CommandEntry>& tree);
[[nodiscard]] std::string zsh_completion(const std::vector<CommandEntry>& tree);

}  // namespace stillmap::command_line
