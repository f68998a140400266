#include "command_line/command_tree.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

#include "command_line/suggestion.hpp"

namespace stillmap::command_line {
namespace {

using Json = nlohmann::json;

CommandEntry::Value completed_value(const CLI::Option& option) {
  OptionValue value = value_of(option);
  return {value.kind, std::move(value.choices)};
}

CommandEntry::Option entry_of(const CLI::Option& option) {
  CommandEntry::Option entry;
  for (const std::string& name : option.get_lnames()) entry.names.push_back("--" + name);
  for (const std::string& name : option.get_snames()) entry.names.push_back("-" + name);
  entry.description = option.get_description();
  entry.value = completed_value(option);
  // A flag that says a form of its own takes a file: `--json[=FILE]`.
  entry.only_assigned = is_flag(option) && !option.get_option_text().empty();
  if (entry.only_assigned) entry.value.kind = ValueKind::kFile;
  return entry;
}

void add_below(const CLI::App& command, std::vector<CommandEntry>& tree) {
  CommandEntry entry;
  entry.name = full_name(command);
  entry.description = command.get_description();
  for (const CLI::Option* option : command.get_options()) {
    if (option->get_positional())
      entry.arguments.push_back(completed_value(*option));
    else if (!option->get_group().empty())
      entry.options.push_back(entry_of(*option));
  }
  tree.push_back(std::move(entry));
  for (const CLI::App* each : listed_commands(command)) add_below(*each, tree);
}

Json json_of(const CommandEntry::Value& value) {
  return {{"kind", static_cast<int>(value.kind)}, {"choices", value.choices}};
}

CommandEntry::Value value_from(const Json& json) {
  return {static_cast<ValueKind>(json.at("kind").get<int>()), json.at("choices")};
}

CommandEntry entry_from(const Json& json) {
  CommandEntry entry;
  entry.name = json.at("name");
  entry.description = json.at("description");
  for (const Json& option : json.at("options"))
    entry.options.push_back({option.at("names"), option.at("description"),
                             value_from(option.at("value")), option.at("only_assigned")});
  for (const Json& argument : json.at("arguments")) entry.arguments.push_back(value_from(argument));
  return entry;
}

}  // namespace

std::vector<CommandEntry> command_tree(const CLI::App& app) {
  std::vector<CommandEntry> tree;
  add_below(app, tree);
  return tree;
}

std::string to_json(const std::vector<CommandEntry>& tree) {
  Json json = Json::array();
  for (const CommandEntry& entry : tree) {
    Json options = Json::array();
    for (const CommandEntry::Option& option : entry.options)
      options.push_back({{"names", option.names},
                         {"description", option.description},
                         {"value", json_of(option.value)},
                         {"only_assigned", option.only_assigned}});
    Json arguments = Json::array();
    for (const CommandEntry::Value& argument : entry.arguments)
      arguments.push_back(json_of(argument));
    json.push_back({{"name", entry.name},
                    {"description", entry.description},
                    {"options", options},
                    {"arguments", arguments}});
  }
  return json.dump() + "\n";
}

std::vector<CommandEntry> command_tree_from(const std::string& json) {
  try {
    std::vector<CommandEntry> tree;
    for (const Json& entry : Json::parse(json)) tree.push_back(entry_from(entry));
    return tree;
  } catch (const Json::exception& error) {
    throw std::runtime_error(std::string("command tree: ") + error.what());
  }
}

}  // namespace stillmap::command_line
