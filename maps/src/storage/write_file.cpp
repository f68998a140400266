#include "storage/write_file.hpp"

#include <stillmap/maps/error.hpp>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <memory>
#include <string>

namespace stillmap::maps {

void write_file(const std::filesystem::path& file, std::string_view bytes) {
  const auto close = [](std::FILE* stream) { std::fclose(stream); };
  std::unique_ptr<std::FILE, decltype(close)> stream(std::fopen(file.c_str(), "wb"), close);
  if (!stream) throw StorageError(file.string(), std::strerror(errno));
  const bool written = std::fwrite(bytes.data(), 1, bytes.size(), stream.get()) == bytes.size();
  // A full disk may show only when the buffer goes out.
  if (!written || std::fclose(stream.release()) != 0) {
    throw StorageError(file.string(), std::strerror(errno));
  }
}

void link_or_copy(const std::filesystem::path& from, const std::filesystem::path& to) {
  namespace fs = std::filesystem;
  std::error_code error;
  if (fs::exists(to, error)) return;
  fs::create_hard_link(from, to, error);
  // Another file system, or one without links.
  if (error && !fs::copy_file(from, to, error))
    throw StorageError(to.string(), error ? error.message() : "cannot be written");
}

}  // namespace stillmap::maps
