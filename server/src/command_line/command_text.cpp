#include "command_line/command_text.hpp"

#include <algorithm>
#include <charconv>
#include <optional>
#include <stdexcept>
#include <string_view>
#include <system_error>
#include <vector>

#include "command_line/option_value.hpp"

namespace stillmap::command_line {
namespace {

std::optional<std::vector<double>> numbers_of(const std::string& text, std::size_t count) {
  std::vector<double> values;
  const char* at = text.data();
  const char* const end = at + text.size();
  while (values.size() < count) {
    if (!values.empty() && (at == end || *at++ != ',')) return std::nullopt;
    const auto [next, error] = std::from_chars(at, end, values.emplace_back());
    if (error != std::errc{}) return std::nullopt;
    at = next;
  }
  return at == end ? std::optional(values) : std::nullopt;
}

}  // namespace

std::string shell_word(const std::string& word) {
  constexpr std::string_view kPlain =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-+=./:,@%";
  if (!word.empty() && word.find_first_not_of(kPlain) == std::string::npos) return word;
  std::string out = "'";
  for (const char letter : word)
    out += letter == '\'' ? std::string("'\\''") : std::string(1, letter);
  return out + "'";
}

std::string command_of(const CLI::App& command) {
  return "stillmap evaluate " + command.get_name() + words_of(command);
}

std::string words_of(const CLI::App& command, std::string_view except) {
  std::string text;
  for (const std::string& word : arguments_of(command, {std::string(except)}))
    text += " " + shell_word(word);
  return text;
}

std::vector<std::string> arguments_of(const CLI::App& command,
                                      const std::vector<std::string>& except) {
  std::vector<std::string> words;
  for (const CLI::Option* option : command.get_options()) {
    if (std::ranges::find(except, option->get_name()) != except.end()) continue;
    for (const std::string& value : option->results()) {
      if (is_flag(*option)) {
        words.push_back(option->get_name() + (value == "true" ? "" : "=" + value));
        continue;
      }
      if (!option->get_positional()) words.push_back(option->get_name());
      words.push_back(value);
    }
  }
  return words;
}

std::array<double, 2> metres_and_degrees(const std::string& option, const std::string& text) {
  const auto values = numbers_of(text, 2);
  if (!values)
    throw std::invalid_argument(option + ": '" + text +
                                "' is not METRES,DEGREES; give two numbers, for example 1,5");
  return {(*values)[0], (*values)[1]};
}

maps::GeodeticOrigin parse_geo_origin(const std::string& text) {
  const auto values = numbers_of(text, 3);
  if (!values)
    throw std::invalid_argument("--geo-origin: '" + text +
                                "' is not LATITUDE,LONGITUDE,ALTITUDE; give three numbers, for "
                                "example 48.1,11.5,520");
  const maps::GeodeticOrigin origin{(*values)[0], (*values)[1], (*values)[2]};
  if (const auto broken = maps::violations(origin); !broken.empty())
    throw std::invalid_argument("--geo-origin: " + broken.front());
  return origin;
}

maps::UtmZone parse_utm_zone(const std::string& text) {
  maps::UtmZone zone;
  const char* const end = text.data() + text.size();
  const auto [side, error] = std::from_chars(text.data(), end, zone.number);
  const bool is_zone = error == std::errc{} && zone.number >= 1 && zone.number <= 60 &&
                       side + 1 == end && (*side == 'N' || *side == 'S');
  if (!is_zone)
    throw std::invalid_argument("--utm: '" + text +
                                "' is no zone; give 1N to 60N or 1S to 60S, for example 32N");
  zone.north = *side == 'N';
  return zone;
}

}  // namespace stillmap::command_line
