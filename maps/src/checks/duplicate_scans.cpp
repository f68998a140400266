#include "checks/duplicate_scans.hpp"

#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "drives/layout.hpp"

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

/// Of a recording, whose messages are read as a whole.
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

using ScanPoints = std::vector<Eigen::Vector3f>;

/// None where the scan cannot be read: whoever needs it says so.
ScanPoints points_of(const Drive& drive, std::size_t scan) {
  try {
    return drive.read(scan).cloud.positions;
  } catch (const InputError&) {
    return {};
  }
}

/// Of messages, whose stamps differ, and that are read as a whole.
DuplicateScans duplicates_in_recording(const Drive& drive) {
  DuplicateScans found;
  const std::size_t step = drive.size() / kMostPairs + 1;
  ScanPoints before;
  for (std::size_t i = 1; i < drive.size(); i += step) {
    ++found.looked_at;
    if (step > 1 || i == 1) before = points_of(drive, i - 1);
    ScanPoints points = points_of(drive, i);
    if (!points.empty() && points == before && found.count++ == 0) found.first = i;
    before = std::move(points);
  }
  return found;
}

}  // namespace

DuplicateScans duplicate_scans(const Drive& drive) {
  if (is_recording(drive.contents().layout)) return duplicates_in_recording(drive);
  DuplicateScans found;
  const std::vector<fs::path>& files = drive.contents().scan_files;
  for (std::size_t i = 1; i < files.size(); ++i) {
    ++found.looked_at;
    if (size_of(files[i]) != size_of(files[i - 1]) || !same_bytes(files[i - 1], files[i])) continue;
    if (found.count++ == 0) found.first = i;
  }
  return found;
}

}  // namespace stillmap::maps
