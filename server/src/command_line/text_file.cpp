#include <stillmap/maps/error.hpp>

#include <cerrno>
#include <fstream>
#include <system_error>

#include "command_line/text_file.hpp"

namespace stillmap::command_line {

void write_text_file(const std::filesystem::path& file, const std::string& text) {
  std::filesystem::path partial = file;
  partial += ".partial";
  std::ofstream stream(partial, std::ios::binary);
  stream << text;
  stream.close();
  std::error_code error =
      stream ? std::error_code() : std::error_code(errno, std::generic_category());
  if (!error) std::filesystem::rename(partial, file, error);
  if (!error) return;
  std::error_code ignored;
  std::filesystem::remove(partial, ignored);
  throw maps::StorageError(file.string(), error.message());
}

}  // namespace stillmap::command_line
