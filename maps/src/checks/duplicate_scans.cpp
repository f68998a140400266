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

/// Of a recording: 200 scans of 2 MB take half a second.
constexpr std::size_t kMostPairs = 100;

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

bool same_points(const Drive& drive, std::size_t a, std::size_t b) {
  const std::vector<Eigen::Vector3f> first = drive.read(a).cloud.positions;
  return !first.empty() && first == drive.read(b).cloud.positions;
}

}  // namespace

DuplicateScans duplicate_scans(const Drive& drive) {
  DuplicateScans found;
  const Drive::Contents& contents = drive.contents();
  const std::vector<fs::path>& files = contents.scan_files;
  const bool is_recording = contents.entries.read != nullptr;
  // Of files mostly the sizes are read; messages as a whole, and their stamps differ.
  const std::size_t step = is_recording ? files.size() / kMostPairs + 1 : 1;
  for (std::size_t i = 1; i < files.size(); i += step) {
    ++found.looked_at;
    const bool same = is_recording ? same_points(drive, i - 1, i)
                                   : size_of(files[i]) == size_of(files[i - 1]) &&
                                         same_bytes(files[i - 1], files[i]);
    if (same && found.count++ == 0) found.first = i;
  }
  return found;
}

}  // namespace stillmap::maps
