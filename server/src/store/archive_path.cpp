#include "store/archive_path.hpp"

#include <stillmap/maps/error.hpp>

#include <algorithm>

namespace stillmap::server {
namespace {

constexpr const char* kExpectedPath = "a relative path of printable ASCII without \\, . and ..";

bool is_printable(char c) { return c >= 0x20 && c <= 0x7e; }

void check_part(std::string_view part, const std::string& place) {
  // Of Linux file systems.
  constexpr std::size_t kLongestName = 255;
  if (part.empty() || part == "." || part == "..")
    throw maps::InputError(place, "'" + std::string(part) + "' in its path", kExpectedPath);
  if (part.size() > kLongestName)
    throw maps::InputError(place, "a name of " + std::to_string(part.size()) + " bytes",
                           std::to_string(kLongestName) + " at most");
}

}  // namespace

std::string shown_path(std::string_view text) {
  constexpr std::size_t kLongest = 100;
  std::string line(text.substr(0, kLongest));
  std::replace_if(
      line.begin(), line.end(), [](char c) { return !is_printable(c); }, '?');
  if (text.size() > kLongest) line += "...";
  return line;
}

std::string checked_path(std::string_view path, bool is_folder, std::size_t most_bytes,
                         std::size_t most_depth, const std::string& place) {
  if (path.size() > most_bytes)
    throw maps::InputError(place, "a path of " + std::to_string(path.size()) + " bytes",
                           std::to_string(most_bytes) + " at most");
  const auto refused =
      std::find_if(path.begin(), path.end(), [](char c) { return !is_printable(c) || c == '\\'; });
  if (refused != path.end())
    throw maps::InputError(place, "byte " + std::to_string(static_cast<unsigned char>(*refused)),
                           kExpectedPath);
  if (path.starts_with('/')) throw maps::InputError(place, "an absolute path", kExpectedPath);
  while (path.starts_with("./")) path.remove_prefix(2);
  if (is_folder && path.ends_with('/')) path.remove_suffix(1);
  if (is_folder && (path.empty() || path == ".")) return {};

  std::size_t depth = 0;
  for (std::size_t from = 0; from <= path.size(); ++depth) {
    const std::size_t to = std::min(path.find('/', from), path.size());
    check_part(path.substr(from, to - from), place);
    from = to + 1;
  }
  if (depth > most_depth)
    throw maps::InputError(place, "a path of " + std::to_string(depth) + " parts",
                           std::to_string(most_depth) + " at most");
  return std::string(path);
}

}  // namespace stillmap::server
