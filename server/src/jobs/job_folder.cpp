#include "jobs/job_folder.hpp"

#include "jobs/child_process.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <stillmap/maps/error.hpp>

#include <fstream>
#include <iterator>
#include <system_error>

namespace stillmap::server {
namespace fs = std::filesystem;

void write_small_file(const fs::path& file, const std::string& text) {
  const fs::path half = file.string() + ".new";
  std::ofstream stream(half, std::ios::binary | std::ios::trunc);
  stream.write(text.data(), static_cast<std::streamsize>(text.size()));
  stream.close();
  std::error_code error;
  if (stream) fs::rename(half, file, error);
  if (!stream || error) throw maps::StorageError(file.string(), "cannot be written");
}

void sync_folder(const fs::path& folder) {
  const Descriptor opened(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (!opened.is_open() || ::fsync(opened.get()) != 0)
    throw maps::StorageError(folder.string(), "cannot be synced");
}

std::optional<std::string> read_small_file(const fs::path& file) {
  constexpr std::uintmax_t kMost = std::uintmax_t{1} << 20U;
  std::error_code error;
  const std::uintmax_t size = fs::file_size(file, error);
  if (error || size > kMost) return std::nullopt;
  std::ifstream stream(file, std::ios::binary);
  if (!stream) return std::nullopt;
  return std::string(std::istreambuf_iterator<char>(stream), {});
}

void clear_folder(const fs::path& folder) {
  std::error_code error;
  fs::remove_all(folder, error);
}

std::uint64_t free_bytes(const fs::path& folder) {
  std::error_code error;
  const fs::space_info space = fs::space(folder, error);
  return error ? 0 : space.available;
}

}  // namespace stillmap::server
