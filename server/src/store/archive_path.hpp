#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace stillmap::server {

/// Text from outside on one line: other than printable ASCII becomes '?', and it is cut.
[[nodiscard]] std::string shown_path(std::string_view text);

/// The path of an archive's entry as it may be joined to a folder: "./" in front and one "/" behind
/// a folder taken away. Empty for the root itself.
/// @param place  for messages. @throws InputError for all other than printable ASCII, backslashes,
/// absolute paths, empty parts, "." and "..", and paths that are too long or deep.
[[nodiscard]] std::string checked_path(std::string_view path, bool is_folder,
                                       std::size_t most_bytes, std::size_t most_depth,
                                       const std::string& place);

}  // namespace stillmap::server
