#include "package/drive_numbers.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <stdexcept>
#include <utility>

namespace stillmap::maps {

DriveNumbers::DriveNumbers(std::vector<MapManifest::DriveCounts> drives)
    : drives_(std::move(drives)) {
  for (const MapManifest::DriveCounts& drive : drives_) {
    scan_ends_.push_back((scan_ends_.empty() ? 0 : scan_ends_.back()) + drive.scans);
    object_ends_.push_back((object_ends_.empty() ? 0 : object_ends_.back()) + drive.objects);
  }
}

DriveNumber DriveNumbers::scan(std::uint32_t over_all) const {
  return of_drive(scan_ends_, over_all);
}

DriveNumber DriveNumbers::object(std::uint32_t over_all) const {
  return of_drive(object_ends_, over_all);
}

std::uint32_t DriveNumbers::scan_over_all(DriveNumber scan) const {
  return over_all(scan_ends_, scan);
}

std::uint32_t DriveNumbers::object_over_all(DriveNumber object) const {
  return over_all(object_ends_, object);
}

DriveNumber DriveNumbers::of_drive(std::span<const std::uint32_t> ends,
                                   std::uint32_t over_all) const {
  if (ends.empty()) return {0, over_all};
  const auto drive = std::upper_bound(ends.begin(), ends.end(), over_all);
  if (drive == ends.end()) throw std::out_of_range(fmt::format("number {} of no drive", over_all));
  return {static_cast<std::uint32_t>(drive - ends.begin()),
          over_all - (drive == ends.begin() ? 0 : *std::prev(drive))};
}

std::uint32_t DriveNumbers::over_all(std::span<const std::uint32_t> ends, DriveNumber what) const {
  if (ends.empty() && what.drive == 0) return what.number;
  const std::uint32_t begin =
      what.drive == 0 || what.drive > ends.size() ? 0 : ends[what.drive - 1];
  if (what.drive >= ends.size() || what.number >= ends[what.drive] - begin)
    throw std::out_of_range(fmt::format("number {} of drive {}", what.number, what.drive));
  return begin + what.number;
}

}  // namespace stillmap::maps
