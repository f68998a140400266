#pragma once

#include <filesystem>
#include <string>

namespace stillmap::maps {

/// Where work on a file or folder lies until it is done: `.NAME` and an ending, in the same folder.
/// @param target  also with a slash at its end.
[[nodiscard]] inline std::filesystem::path hidden_beside(const std::filesystem::path& target,
                                                         const std::string& ending) {
  const std::filesystem::path whole = std::filesystem::absolute(target).lexically_normal();
  const std::filesystem::path named = whole.has_filename() ? whole : whole.parent_path();
  return named.parent_path() / ("." + named.filename().string() + ending);
}

}  // namespace stillmap::maps
