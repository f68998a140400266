#include <stillmap/maps/store/map_name.hpp>

#include <algorithm>

namespace stillmap::maps {
namespace {

bool is_low_letter_or_digit(char c) { return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9'); }

}  // namespace

bool is_valid_map_name(std::string_view name) {
  constexpr std::size_t kLongest = 63;
  if (name.empty() || name.size() > kLongest || !is_low_letter_or_digit(name.front())) return false;
  return std::all_of(name.begin(), name.end(), [](char c) {
    return is_low_letter_or_digit(c) || c == '.' || c == '_' || c == '-';
  });
}

}  // namespace stillmap::maps
