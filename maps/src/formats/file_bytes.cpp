#include "formats/file_bytes.hpp"

#include <stillmap/maps/error.hpp>

#include <cerrno>
#include <cstdio>
#include <system_error>

namespace stillmap::maps {
namespace {

struct Close {
  void operator()(std::FILE* stream) const { std::fclose(stream); }
};

StorageError system_error(const std::filesystem::path& file, int code) {
  return {file.string(), std::generic_category().message(code)};
}

}  // namespace

FileBytes read_bytes(const std::filesystem::path& file) {
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(file, error);
  if (error) throw system_error(file, error.value());
  // A pipe or a device may never end.
  if (!std::filesystem::is_regular_file(status)) {
    throw StorageError(file.string(), "not a regular file");
  }
  const std::unique_ptr<std::FILE, Close> stream(std::fopen(file.c_str(), "rb"));
  if (!stream) throw system_error(file, errno);
  const std::uintmax_t size = std::filesystem::file_size(file, error);
  if (error) throw system_error(file, error.value());
  auto bytes = std::make_unique_for_overwrite<std::byte[]>(size);
  std::setvbuf(stream.get(), nullptr, _IONBF, 0);
  if (std::fread(bytes.get(), 1, size, stream.get()) != size) {
    throw StorageError(file.string(), "could not be read to its end");
  }
  return {std::move(bytes), size};
}

}  // namespace stillmap::maps
