#include "command_line/option_value.hpp"

#include <fmt/format.h>
#include <stillmap/maps/text.hpp>

#include <algorithm>
#include <map>
#include <string_view>
#include <utility>

namespace stillmap::command_line {
namespace {

/// CLI11 joins the type's name and the descriptions of all validators with colons.
std::vector<std::string> parts_of(const std::string& type_name) {
  std::vector<std::string> parts;
  std::size_t begin = 0;
  for (std::size_t i = 0; i <= type_name.size(); ++i) {
    if (i < type_name.size() && type_name[i] != ':') continue;
    parts.push_back(type_name.substr(begin, i - begin));
    begin = i + 1;
  }
  return parts;
}

std::vector<std::string> words_between(const std::string& text, char open, char close) {
  std::vector<std::string> words;
  const std::size_t begin = text.find(open);
  const std::size_t end = text.rfind(close);
  if (begin == std::string::npos || end == std::string::npos) return words;
  std::string word;
  for (const char letter : text.substr(begin + 1, end - begin - 1) + ",") {
    if (letter != ',') {
      word += letter;
    } else if (!word.empty()) {
      words.push_back(std::exchange(word, {}));
    }
  }
  return words;
}

struct Named {
  std::string_view name;
  ValueKind kind;
};

/// By the description of a validator of ours, or the name of a type.
const std::map<std::string, Named, std::less<>> kNames = {
    {"folder", {"FOLDER", ValueKind::kFolder}},
    {"FOLDER", {"FOLDER", ValueKind::kFolder}},
    {"file", {"FILE", ValueKind::kFile}},
    {"FILE", {"FILE", ValueKind::kFile}},
    {"folder or bag", {"DRIVE", ValueKind::kFile}},
    {"file or folder", {"PATH", ValueKind::kFile}},
    {"PATH", {"PATH", ValueKind::kFile}},
    {"FLOAT", {"NUMBER", ValueKind::kNumber}},
    {"INT", {"NUMBER", ValueKind::kNumber}},
    {"UINT", {"NUMBER", ValueKind::kNumber}},
    {"TEXT", {"TEXT", ValueKind::kText}},
    {"scan file or drive", {"PATH", ValueKind::kFile}},
};

}  // namespace

bool is_flag(const CLI::Option& option) {
  return option.get_expected_max() == 0 || option.get_type_size() == 0;
}

OptionValue value_of(const CLI::Option& option) {
  if (is_flag(option)) return {.kind = ValueKind::kNone, .name = {}, .choices = {}, .bounds = {}};
  OptionValue value;
  for (const std::string& part : parts_of(option.get_type_name())) {
    if (const auto known = kNames.find(part); known != kNames.end()) {
      value.kind = known->second.kind;
      value.name = known->second.name;
    } else if (part.starts_with('{')) {
      value.choices = words_between(part, '{', '}');
      value.name = "NAME";
    } else if (const std::size_t at = part.find(" in ["); at != std::string::npos) {
      value.bounds = part.substr(at + 5, part.size() - at - 6);
      if (const std::size_t dash = value.bounds.find(" - "); dash != std::string::npos)
        value.bounds.replace(dash, 3, " to ");
    } else if (value.name.empty()) {
      value.name = part;
    }
  }
  return value;
}

CLI::Validator one_of(std::vector<std::string> choices) {
  const std::string described = fmt::format("{{{}}}", fmt::join(choices, ","));
  return CLI::Validator(
      [choices = std::move(choices)](const std::string& word) {
        if (std::ranges::find(choices, word) != choices.end()) return std::string();
        const auto nearest = maps::nearest_of(word, choices);
        return fmt::format("'{}' is not a choice; {} one of: {}", word,
                           nearest ? fmt::format("did you mean '{}'? Choose", *nearest) : "choose",
                           fmt::join(choices, ", "));
      },
      described);
}

}  // namespace stillmap::command_line
