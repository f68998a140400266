#pragma once

#include <stillmap/maps/map_package.hpp>

#include <compare>
#include <cstdint>
#include <span>
#include <vector>

namespace stillmap::maps {

/// A scan or an object by the drive it is of and its number there, so that another drive leaves the
/// numbers of the others alone.
struct DriveNumber {
  std::uint32_t drive = 0;
  std::uint32_t number = 0;
  auto operator<=>(const DriveNumber&) const = default;
};

/// Numbers over all drives of a map, and those by drive. A map without drives counts as one of any
/// size.
class DriveNumbers {
 public:
  DriveNumbers() = default;
  explicit DriveNumbers(std::vector<MapManifest::DriveCounts> drives);

  [[nodiscard]] const std::vector<MapManifest::DriveCounts>& drives() const { return drives_; }
  [[nodiscard]] bool has_drive(std::uint32_t drive) const {
    return drives_.empty() ? drive == 0 : drive < drives_.size();
  }
  /// @throws std::out_of_range for what no drive has.
  [[nodiscard]] DriveNumber scan(std::uint32_t over_all) const;
  [[nodiscard]] DriveNumber object(std::uint32_t over_all) const;
  [[nodiscard]] std::uint32_t scan_over_all(DriveNumber scan) const;
  [[nodiscard]] std::uint32_t object_over_all(DriveNumber object) const;

 private:
  [[nodiscard]] DriveNumber of_drive(std::span<const std::uint32_t> ends,
                                     std::uint32_t over_all) const;
  [[nodiscard]] std::uint32_t over_all(std::span<const std::uint32_t> ends, DriveNumber what) const;

  std::vector<MapManifest::DriveCounts> drives_;
  /// Where the numbers of each drive end.
  std::vector<std::uint32_t> scan_ends_, object_ends_;
};

}  // namespace stillmap::maps
