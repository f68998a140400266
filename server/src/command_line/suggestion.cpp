#include "command_line/suggestion.hpp"

#include <fmt/format.h>
#include <stillmap/maps/text.hpp>

#include <algorithm>
#include <cctype>
#include <stdexcept>
#include <string_view>

namespace stillmap::command_line {
namespace {

std::string hint(const std::optional<std::string>& nearest) {
  return nearest ? fmt::format("; did you mean '{}'?", *nearest) : ".";
}

const CLI::App& known_command(const CLI::App& group, const std::string& word) {
  const auto all = group.get_subcommands([](const CLI::App*) { return true; });
  const auto found =
      std::ranges::find_if(all, [&](const CLI::App* each) { return each->get_name() == word; });
  if (found != all.end()) return **found;
  std::vector<std::string> names;
  for (const CLI::App* each : listed_commands(group)) names.push_back(each->get_name());
  throw std::invalid_argument(fmt::format("no command '{}'{} See {} --help.", word,
                                          hint(maps::nearest_of(word, names)), full_name(group)));
}

/// Names of an option as they are typed.
std::vector<std::string> option_names(const CLI::App& command) {
  std::vector<std::string> names;
  for (const CLI::Option* option : command.get_options()) {
    if (option->get_group().empty()) continue;
    for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
    for (const std::string& name : option->get_snames()) names.push_back("-" + name);
  }
  return names;
}

/// As CLI11 reads it: a number with a minus is a value.
bool is_option(std::string_view word) {
  return word.size() > 1 && word[0] == '-' &&
         (word[1] == '-' || std::isalpha(static_cast<unsigned char>(word[1])) != 0);
}

void require_known_option(const CLI::App& command, const std::string& word) {
  // `--name=value`; `-nvalue`.
  const std::string name =
      word.starts_with("--") ? word.substr(0, word.find('=')) : word.substr(0, 2);
  if (command.get_option_no_throw(name) != nullptr) return;
  throw std::invalid_argument(fmt::format("no option '{}'{} See {} --help.", name,
                                          hint(maps::nearest_of(name, option_names(command))),
                                          full_name(command)));
}

}  // namespace

void require_known_words(const CLI::App& app, std::span<char* const> words) {
  const CLI::App* command = &app;
  for (const std::string word : words) {
    if (word == "--") return;
    if (is_option(word)) {
      require_known_option(*command, word);
    } else if (!command->get_subcommands([](const CLI::App*) { return true; }).empty()) {
      command = &known_command(*command, word);
    }
  }
}

std::string full_name(const CLI::App& command) {
  return command.get_parent() == nullptr
             ? command.get_name()
             : full_name(*command.get_parent()) + " " + command.get_name();
}

std::vector<const CLI::App*> listed_commands(const CLI::App& app) {
  std::vector<const CLI::App*> listed;
  for (const CLI::App* each : app.get_subcommands([](const CLI::App*) { return true; }))
    if (!each->get_group().empty()) listed.push_back(each);
  return listed;
}

}  // namespace stillmap::command_line
