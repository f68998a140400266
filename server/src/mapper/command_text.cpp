#include "mapper/command_text.hpp"

#include <charconv>
#include <stdexcept>
#include <string_view>
#include <system_error>

namespace stillmap::mapper {
namespace {

/// As a shell reads it.
std::string quoted(const std::string& word) {
  constexpr std::string_view kPlain =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-+=./:,@%";
  if (!word.empty() && word.find_first_not_of(kPlain) == std::string::npos) return word;
  std::string out = "'";
  for (const char letter : word)
    out += letter == '\'' ? std::string("'\\''") : std::string(1, letter);
  return out + "'";
}

}  // namespace

std::string command_of(const CLI::App& command) {
  std::string text = "stillmap evaluate " + command.get_name();
  for (const CLI::Option* option : command.get_options()) {
    for (const std::string& value : option->results()) {
      if (!option->get_positional()) text += " " + option->get_name();
      text += " " + quoted(value);
    }
  }
  return text;
}

std::array<double, 2> metres_and_degrees(const std::string& option, const std::string& text) {
  std::array<double, 2> values{};
  const char* const end = text.data() + text.size();
  const auto [comma, metres_error] = std::from_chars(text.data(), end, values[0]);
  if (metres_error == std::errc{} && comma != end && *comma == ',') {
    const auto [last, degrees_error] = std::from_chars(comma + 1, end, values[1]);
    if (degrees_error == std::errc{} && last == end) return values;
  }
  throw std::invalid_argument(option + ": found '" + text + "', expected METRES,DEGREES");
}

}  // namespace stillmap::mapper
