#include <stillmap/maps/error.hpp>

#include <cerrno>
#include <fstream>
#include <system_error>

#include "command_line/text_file.hpp"

namespace stillmap::command_line {
namespace {

std::error_code write(const std::filesystem::path& file, const std::string& text) {
  std::ofstream stream(file, std::ios::binary);
  stream << text;
  stream.close();
  return stream ? std::error_code() : std::error_code(errno, std::generic_category());
}

/// Whether a rename onto it would take away a device, a pipe or a link.
bool is_special(const std::filesystem::path& file) {
  std::error_code ignored;
  const auto status = std::filesystem::symlink_status(file, ignored);
  return std::filesystem::exists(status) && !std::filesystem::is_regular_file(status);
}

}  // namespace

void write_text_file(const std::filesystem::path& file, const std::string& text) {
  if (is_special(file)) {
    if (const std::error_code error = write(file, text))
      throw maps::StorageError(file.string(), error.message());
    return;
  }
  std::filesystem::path partial = file;
  partial += ".partial";
  std::error_code error = write(partial, text);
  if (!error) std::filesystem::rename(partial, file, error);
  if (!error) return;
  std::error_code ignored;
  std::filesystem::remove(partial, ignored);
  throw maps::StorageError(file.string(), error.message());
}

}  // namespace stillmap::command_line
