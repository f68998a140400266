#pragma once

#include <filesystem>
#include <string_view>

namespace stillmap::maps {

/// Replaces a file's content. @throws StorageError naming it and the system's reason.
void write_file(const std::filesystem::path& file, std::string_view bytes);

}  // namespace stillmap::maps
