#pragma once

#include <filesystem>
#include <string>

namespace stillmap::command_line {

/// Replaces a file in one step, so that nobody reads half of it. What is no plain file
/// (`/dev/stdout`, a pipe, a link) is written to as it is, never replaced.
/// @throws maps::StorageError.
void write_text_file(const std::filesystem::path& file, const std::string& text);

}  // namespace stillmap::command_line
