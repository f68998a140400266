#include <stillmap/maps/drive.hpp>

#include <algorithm>
#include <charconv>
#include <stdexcept>

namespace stillmap::maps {
namespace {

[[noreturn]] void refuse_selection(std::string_view text) {
  throw std::invalid_argument(
      "selection '" + std::string(text) +
      "': expected a:b:step of whole numbers >= 0, step >= 1, any left out");
}

std::optional<std::size_t> parse_part(std::string_view part, std::string_view text) {
  if (part.empty()) return std::nullopt;
  std::size_t value = 0;
  const auto [stop, error] = std::from_chars(part.data(), part.data() + part.size(), value);
  if (error != std::errc() || stop != part.data() + part.size()) refuse_selection(text);
  return value;
}

}  // namespace

Selection Selection::parse(std::string_view text) {
  std::vector<std::string_view> parts;
  std::string_view rest = text;
  for (std::size_t colon = rest.find(':'); colon != std::string_view::npos;
       colon = rest.find(':')) {
    parts.push_back(rest.substr(0, colon));
    rest.remove_prefix(colon + 1);
  }
  parts.push_back(rest);
  if (parts.size() < 2 || parts.size() > 3) refuse_selection(text);
  Selection selection;
  selection.begin = parse_part(parts[0], text).value_or(0);
  selection.end = parse_part(parts[1], text);
  if (parts.size() == 3) selection.step = parse_part(parts[2], text).value_or(1);
  if (selection.step == 0) refuse_selection(text);
  return selection;
}

std::vector<std::size_t> Selection::indices(std::size_t size) const {
  if (step == 0) throw std::invalid_argument("selection: step 0, must be >= 1");
  std::vector<std::size_t> result;
  const std::size_t stop = std::min(end.value_or(size), size);
  for (std::size_t i = begin; i < stop;) {
    result.push_back(i);
    if (step >= stop - i) break;  // also where i + step would wrap
    i += step;
  }
  return result;
}

}  // namespace stillmap::maps
