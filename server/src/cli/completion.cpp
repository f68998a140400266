#include <fmt/core.h>

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "command_line/command_tree.hpp"
#include "command_line/option_value.hpp"
#include "commands.hpp"

namespace stillmap::cli {
namespace {

using command_line::CommandEntry;

/// The commands of this program and, with their options, those of the other programs.
std::vector<CommandEntry> all_commands(const CLI::App& app) {
  std::vector<CommandEntry> all = command_line::command_tree(app);
  for (CommandEntry& entry : offline_commands()) {
    // Each program lists itself first.
    if (entry.name == app.get_name()) continue;
    const auto known = std::ranges::find(all, entry.name, &CommandEntry::name);
    if (known != all.end())
      *known = std::move(entry);
    else
      all.push_back(std::move(entry));
  }
  return all;
}

}  // namespace

void add_completion(CLI::App& app) {
  auto shell = std::make_shared<std::string>();
  CLI::App* command =
      app.add_subcommand("completion", "Print the script that completes commands in a shell");
  command->add_option("SHELL", *shell, "bash or zsh")
      ->required()
      ->check(command_line::one_of({"bash", "zsh"}));
  command->footer(
      "To use it in this shell: source <(stillmap completion bash). The Debian package installs "
      "it\n"
      "for both shells.");
  command->callback([shell, &app] {
    const std::vector<CommandEntry> tree = all_commands(app);
    fmt::print("{}", *shell == "bash" ? command_line::bash_completion(tree)
                                      : command_line::zsh_completion(tree));
  });
}

}  // namespace stillmap::cli
