#pragma once

#include <filesystem>
#include <string_view>

namespace stillmap::maps {

/// Replaces a file's content. @throws StorageError naming it and the system's reason.
void write_file(const std::filesystem::path& file, std::string_view bytes);

/// The same file at another place, for one that never changes: takes no room where the file system
/// has hard links. Does nothing where one lies already.
/// @throws StorageError naming it and the system's reason.
void link_or_copy(const std::filesystem::path& from, const std::filesystem::path& to);

}  // namespace stillmap::maps
