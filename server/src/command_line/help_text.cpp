#include "command_line/help_text.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <string_view>
#include <vector>

#include "command_line/option_value.hpp"
#include "command_line/suggestion.hpp"

namespace stillmap::command_line {
namespace {

constexpr std::size_t kWidth = 100;
/// Where descriptions begin.
constexpr std::size_t kColumn = 30;

/// Breaks text at spaces, each line behind `indent` spaces.
/// @param used  columns of the first line that are taken.
std::string wrapped(std::string_view text, std::size_t indent, std::size_t used) {
  std::string out;
  std::size_t column = used;
  if (column < indent) {
    out.append(indent - column, ' ');
    column = indent;
  }
  bool begins = true;
  while (!text.empty()) {
    const std::string_view word = text.substr(0, text.find(' '));
    text.remove_prefix(std::min(text.size(), word.size() + 1));
    if (!begins && column + 1 + word.size() > kWidth) {
      out += "\n" + std::string(indent, ' ');
      column = indent;
      begins = true;
    }
    if (!begins) out += ' ';
    out += word;
    column += word.size() + (begins ? 0 : 1);
    begins = false;
  }
  return out + "\n";
}

std::string entry(const std::string& left, const std::string& text) {
  const std::string begun = "  " + left;
  // Two spaces at least lie between a name and its description.
  if (begun.size() + 2 <= kColumn) return begun + wrapped(text, kColumn, begun.size());
  return begun + "\n" + wrapped(text, kColumn, 0);
}

std::string default_of(const CLI::Option& option) {
  std::string text = option.get_default_str();
  // Lists come as [a,b], and are given as a,b.
  if (text.starts_with('[') && text.ends_with(']')) text = text.substr(1, text.size() - 2);
  return text;
}

std::string description_of(const CLI::Option& option) {
  const OptionValue value = value_of(option);
  std::string text = option.get_description();
  std::vector<std::string> more;
  const bool says_choices = std::ranges::all_of(
      value.choices, [&](const std::string& each) { return text.find(each) != std::string::npos; });
  if (!says_choices) more.push_back(fmt::format("one of {}", fmt::join(value.choices, ", ")));
  if (!value.bounds.empty()) more.push_back(value.bounds);
  if (value.kind != ValueKind::kNone && !default_of(option).empty())
    more.push_back("default: " + default_of(option));
  if (option.get_required() && !option.get_positional()) more.emplace_back("required");
  for (const CLI::Option* needed : option.get_needs())
    more.push_back("needs " + needed->get_name());
  return more.empty() ? text : fmt::format("{} ({})", text, fmt::join(more, "; "));
}

std::string left_of(const CLI::Option& option) {
  std::vector<std::string> names;
  for (const std::string& name : option.get_snames()) names.push_back("-" + name);
  for (const std::string& name : option.get_lnames()) names.push_back("--" + name);
  std::string left = fmt::format("{}", fmt::join(names, ", "));
  const OptionValue value = value_of(option);
  const std::string name = option.get_option_text().empty() ? value.name : option.get_option_text();
  // A flag may say its own form, such as [=FILE].
  if (!name.empty()) left += (name.front() == '[' ? "" : " ") + name;
  if (option.get_expected_min() == 2 && option.get_expected_max() == 2) left += " " + value.name;
  return left;
}

bool is_many(const CLI::Option& option) { return option.get_expected_max() > 2; }

std::vector<const CLI::Option*> arguments_of(const CLI::App& app) {
  return app.get_options([](const CLI::Option* option) { return option->get_positional(); });
}

std::string usage(const CLI::App& app) {
  std::string text = "Usage: " + full_name(app) + " [OPTIONS]";
  for (const CLI::Option* option : arguments_of(app)) {
    const std::string name = option->get_name(true) + (is_many(*option) ? "..." : "");
    text += option->get_required() ? " " + name : " [" + name + "]";
  }
  if (!listed_commands(app).empty()) text += " COMMAND";
  return text + "\n";
}

std::string arguments(const CLI::App& app) {
  std::string text;
  for (const CLI::Option* option : arguments_of(app))
    text +=
        entry(option->get_name(true) + (is_many(*option) ? "..." : ""), description_of(*option));
  return text.empty() ? text : "\nArguments:\n" + text;
}

std::string options(const CLI::App& app) {
  std::string text;
  for (const std::string& group : app.get_groups()) {
    if (group.empty()) continue;
    const auto listed = app.get_options([&](const CLI::Option* option) {
      return option->get_group() == group && option->nonpositional();
    });
    if (listed.empty()) continue;
    text += "\n" + group + ":\n";
    for (const CLI::Option* option : listed)
      text += entry(left_of(*option), description_of(*option));
  }
  return text;
}

std::string commands(const CLI::App& app) {
  std::string text;
  for (const CLI::App* each : listed_commands(app))
    text += entry(each->get_name(), each->get_description());
  return text.empty() ? text : "\nCommands:\n" + text;
}

}  // namespace

std::string HelpText::make_help(const CLI::App* app, std::string, CLI::AppFormatMode) const {
  std::string text = wrapped(app->get_description(), 0, 0) + usage(*app) + arguments(*app) +
                     options(*app) + commands(*app);
  if (!app->get_footer().empty()) text += "\n" + app->get_footer() + "\n";
  return text;
}

}  // namespace stillmap::command_line
