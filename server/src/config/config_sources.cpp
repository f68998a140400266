#include "config_sources.hpp"

#include "config_file.hpp"
#include "value_text.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <set>

namespace stillmap::server {
namespace {

class Resolver {
 public:
  explicit Resolver(ResolvedConfig& result) : result_(result) {}

  void take_file(const std::filesystem::path& file) {
    ConfigText text = read_config(file);
    for (const auto& [option, value] : text.values) assign(*option, value, file.string());
    for (const ConfigProblem& problem : text.problems) refused_.insert(problem.name);
    std::ranges::move(text.problems, std::back_inserter(result_.problems));
  }

  void take_variable(const std::string& name, const std::string& text) {
    const auto option = std::ranges::find(all_options(), name, &Option::variable);
    if (option == all_options().end()) return refuse_variable(name, text);
    take_text(*option, text, "environment", name);
  }

  void take_flag(const std::string& key, const std::string& text) {
    const Option& option = *find_option(key);
    take_text(option, text, "command line", option.flag());
  }

  /// Options that are right each and do not go together. Where one was refused, its default would
  /// be judged.
  void check_together() {
    for (BrokenOption& broken : broken_options(result_.options)) {
      if (refused_.contains(broken.key) || refused_.contains(broken.other)) continue;
      const auto origin = result_.origins.find(broken.key);
      result_.problems.push_back(
          {origin == result_.origins.end() ? std::string("default") : origin->second, broken.key,
           std::move(broken.found), std::move(broken.expected)});
    }
  }

 private:
  void take_text(const Option& option, const std::string& text, const std::string& source,
                 const std::string& name) {
    const std::optional<OptionValue> value = read_value(option, text);
    if (value && assign(option, *value, name)) return;
    refused_.insert(std::string(option.key));
    result_.problems.push_back({source, name, shown_text(text), option.expected()});
  }

  bool assign(const Option& option, const OptionValue& value, const std::string& origin) {
    if (!option.set(result_.options, value)) return false;
    result_.origins[std::string(option.key)] = origin;
    return true;
  }

  void refuse_variable(const std::string& name, const std::string& text) {
    std::string key = name.substr(kVariablePrefix.size());
    std::ranges::transform(key, key.begin(), [](char c) {
      return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
    });
    const Option* nearest = find_option(nearest_key(key));
    result_.problems.push_back(
        {"environment", shown_text(name), shown_text(text),
         nearest == nullptr
             ? std::string("a known variable")
             : fmt::format("a known variable, the nearest is {}", nearest->variable())});
  }

  ResolvedConfig& result_;
  std::set<std::string> refused_;
};

}  // namespace

std::vector<std::pair<std::string, std::string>> own_environment() {
  std::vector<std::pair<std::string, std::string>> result;
  for (char** each = environ; each != nullptr && *each != nullptr; ++each) {
    const std::string_view line = *each;
    const std::size_t equals = line.find('=');
    const std::string_view name = line.substr(0, equals);
    if (equals == std::string_view::npos || !name.starts_with(kVariablePrefix)) continue;
    if (name != kConfigVariable) result.emplace_back(name, line.substr(equals + 1));
  }
  std::ranges::sort(result);
  return result;
}

ResolvedConfig resolve(const ConfigSources& sources) {
  ResolvedConfig result;
  Resolver resolver(result);
  if (sources.file) resolver.take_file(*sources.file);
  for (const auto& [name, text] : sources.environment) resolver.take_variable(name, text);
  for (const auto& [key, text] : sources.flags) resolver.take_flag(key, text);
  resolver.check_together();
  return result;
}

}  // namespace stillmap::server
