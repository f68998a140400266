#include "store/store_folder.hpp"

#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <chrono>
#include <system_error>

namespace stillmap::server {

namespace fs = std::filesystem;

std::int64_t now_ns() {
  using std::chrono::system_clock;
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             system_clock::now().time_since_epoch())
      .count();
}

bool is_digest(std::string_view name) {
  return name.size() == 64 && name.find_first_not_of("0123456789abcdef") == std::string_view::npos;
}

std::vector<std::string> folders_in(const fs::path& folder) {
  std::vector<std::string> names;
  std::error_code error;
  fs::directory_iterator at(folder, error);
  for (; !error && at != fs::directory_iterator(); at.increment(error))
    if (at->symlink_status().type() == fs::file_type::directory)
      names.push_back(at->path().filename().string());
  if (error) throw maps::StorageError(folder.string(), error.message());
  std::sort(names.begin(), names.end());
  return names;
}

bool is_there(const fs::path& path) {
  std::error_code error;
  const fs::file_type type = fs::symlink_status(path, error).type();
  if (type == fs::file_type::none) throw maps::StorageError(path.string(), error.message());
  return type != fs::file_type::not_found;
}

}  // namespace stillmap::server
