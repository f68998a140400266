#include "checks/duplicate_scans.hpp"

#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string>
#include <system_error>

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

std::uintmax_t size_of(const fs::path& file) {
  std::error_code error;
  const std::uintmax_t size = fs::file_size(file, error);
  if (error) throw StorageError(file.string(), error.message());
  return size;
}

bool same_bytes(const fs::path& a, const fs::path& b) {
  constexpr std::streamsize kAtOnce = 65536;
  std::ifstream first(a, std::ios::binary), second(b, std::ios::binary);
  std::string left(kAtOnce, '\0'), right(kAtOnce, '\0');
  // Scans of one size differ in their first points.
  for (std::streamsize piece = 4096; first && second; piece = kAtOnce) {
    first.read(left.data(), piece);
    second.read(right.data(), piece);
    const auto count = first.gcount();
    if (count != second.gcount() || !std::equal(left.begin(), left.begin() + count, right.begin()))
      return false;
  }
  return !first && !second;
}

}  // namespace

DuplicateScans duplicate_scans(const Drive& drive) {
  DuplicateScans found;
  const std::vector<fs::path>& files = drive.contents().scan_files;
  for (std::size_t i = 1; i < files.size(); ++i) {
    if (files[i] == files[i - 1] || size_of(files[i]) != size_of(files[i - 1])) continue;
    if (!same_bytes(files[i - 1], files[i])) continue;
    if (found.count++ == 0) found.first = i;
  }
  return found;
}

}  // namespace stillmap::maps
