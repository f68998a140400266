#include "config_text.hpp"

#include "http/request_id.hpp"
#include "option_table.hpp"
#include "value_text.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

namespace stillmap::server {
namespace {

using Json = nlohmann::ordered_json;

Json schema_of(const Option& option) {
  Json schema;
  schema["description"] = option.unit.empty() ? std::string(option.text)
                                              : fmt::format("{} [{}]", option.text, option.unit);
  const OptionKind kind = option.kind();
  switch (kind) {
    case OptionKind::kFlag:
      schema["type"] = "boolean";
      break;
    case OptionKind::kInteger:
      schema["type"] = "integer";
      schema["minimum"] = static_cast<std::int64_t>(option.least);
      schema["maximum"] = static_cast<std::int64_t>(option.most);
      break;
    case OptionKind::kReal:
      schema["type"] = "number";
      schema["minimum"] = option.least;
      schema["maximum"] = option.most;
      break;
    case OptionKind::kChoice:
      schema["enum"] = option.choices;
      break;
    case OptionKind::kText:
      schema["type"] = "string";
      schema["maxLength"] = kMostTextBytes;
      schema["pattern"] = "^[^\\u0000-\\u001f\\u007f]*$";
      break;
  }
  std::visit([&schema](const auto& value) { schema["default"] = value; },
             option.get(ServerOptions{}));
  return schema;
}

Json empty_object() {
  Json schema;
  schema["type"] = "object";
  schema["additionalProperties"] = false;
  schema["properties"] = Json::object();
  return schema;
}

/// Those that the command line and a page need apart: "sessions" of "sessions.max".
std::string_view group_of(std::string_view key) {
  const std::size_t dot = key.find('.');
  return dot == std::string_view::npos ? std::string_view() : key.substr(0, dot);
}

std::string_view name_of(std::string_view key) {
  const std::size_t dot = key.find('.');
  return dot == std::string_view::npos ? key : key.substr(dot + 1);
}

std::string table_row(const Option& option) {
  std::string bounds;
  const OptionKind kind = option.kind();
  if (kind == OptionKind::kChoice) bounds = fmt::format("{}", fmt::join(option.choices, ", "));
  if (kind == OptionKind::kInteger || kind == OptionKind::kReal)
    bounds = fmt::format("{:.16g} to {:.16g}", option.least, option.most);
  return fmt::format("| `{}` | {} | {} | {} | {} | {} |\n", option.key,
                     value_text(option.get(ServerOptions{})), bounds, option.unit,
                     option.reloadable ? "yes" : "", option.text);
}

}  // namespace

std::string config_schema() {
  Json schema = {{"$schema", "https://json-schema.org/draft/2020-12/schema"},
                 {"title", "Configuration of stillmap serve"}};
  schema.update(empty_object());
  for (const Option& option : all_options()) {
    Json& top = schema["properties"];
    const std::string group(group_of(option.key));
    if (!group.empty() && !top.contains(group)) top[group] = empty_object();
    Json& place = group.empty() ? top : top[group]["properties"];
    place[std::string(name_of(option.key))] = schema_of(option);
  }
  return schema.dump(2) + "\n";
}

std::string config_page() {
  std::string page = fmt::format(
      "# Options of stillmap serve\n\n"
      "Written by `stillmap serve --print-page`. How to give options: `server/operation.md`. The "
      "flag of\n`sessions.max` is `{}`, its variable `{}`. *Reload*: SIGHUP changes it in the\n"
      "running server.\n\n| key | default | bounds | unit | reload | meaning |\n"
      "|---|---|---|---|---|---|\n",
      find_option("sessions.max")->flag(), find_option("sessions.max")->variable());
  for (const Option& option : all_options()) page += table_row(option);
  return page;
}

std::string config_listing(const ResolvedConfig& config) {
  std::string result = "{\n";
  std::string_view group;
  const std::span<const Option> options = all_options();
  for (std::size_t i = 0; i < options.size(); ++i) {
    const Option& option = options[i];
    const std::string_view own = group_of(option.key);
    if (own != group && !own.empty()) result += fmt::format("  {}: {{\n", shown_text(own));
    group = own;
    const std::string_view next =
        i + 1 < options.size() ? group_of(options[i + 1].key) : std::string_view();
    const bool last_of_group = next != own || i + 1 == options.size();
    const auto origin = config.origins.find(std::string(option.key));
    result += fmt::format("  {}{}: {}{}  // {}\n", own.empty() ? "" : "  ",
                          shown_text(name_of(option.key)), value_text(option.get(config.options)),
                          last_of_group && !own.empty() ? "" : ",",
                          origin == config.origins.end() ? "default" : printable(origin->second));
    if (last_of_group && !own.empty()) result += i + 1 < options.size() ? "  },\n" : "  }\n";
  }
  return result + "}\n";
}

}  // namespace stillmap::server
