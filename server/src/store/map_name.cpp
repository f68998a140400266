#include "store/map_name.hpp"

#include <algorithm>

namespace stillmap::server {
namespace {

constexpr std::size_t kLongestMapName = 63;

bool is_low_letter_or_digit(char c) { return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9'); }

}  // namespace

bool is_valid_map_name(std::string_view name) {
  if (name.empty() || name.size() > kLongestMapName || !is_low_letter_or_digit(name.front()))
    return false;
  return std::all_of(name.begin(), name.end(), [](char c) {
    return is_low_letter_or_digit(c) || c == '.' || c == '_' || c == '-';
  });
}

std::string map_name_of(std::string_view text) {
  std::string name;
  for (char c : text) {
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
    const bool is_mark = c == '.' || c == '_' || c == '-';
    if (!is_low_letter_or_digit(c) && !is_mark) c = '-';
    if (name.empty() && !is_low_letter_or_digit(c)) continue;
    if (name.size() < kLongestMapName) name += c;
  }
  return name.empty() ? "map" : name;
}

}  // namespace stillmap::server
