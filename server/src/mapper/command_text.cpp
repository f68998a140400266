#include "mapper/command_text.hpp"

#include <string_view>

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

}  // namespace stillmap::mapper
