#pragma once

#include "fuzz_folder.hpp"
#include "scan_rules.hpp"

#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/geodesy.hpp>

namespace stillmap::fuzz {

/// Reads all scans of a drive.
inline void read_through(const maps::Drive& drive) {
  const auto& stamps = drive.contents().stamps_ns;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    require(i == 0 || stamps[i] > stamps[i - 1], "stamps increase");
    if (drive.has_poses()) require(drive.T_map_lidar(i).matrix().allFinite(), "poses are finite");
    const auto scan = taken<maps::InputError, maps::StorageError>([&] { return drive.read(i); });
    if (scan) require_whole(scan->cloud);
  }
}

/// Opens the file as a drive and reads all its scans; where it has poses, also placed by the fixes
/// that it may have.
inline void drive_through(const std::filesystem::path& file) {
  const auto opened = [](const std::filesystem::path& name) {
    return taken<maps::InputError, maps::StorageError>([&] { return maps::Drive::open(name); });
  };
  const auto drive = opened(file);
  if (!drive) return;
  read_through(*drive);
  if (!drive->has_poses()) return;
  const auto placed = opened(file.string() + "?gnss=/fix");
  if (!placed) return;
  require(placed->contents().origin && maps::violations(*placed->contents().origin).empty(),
          "what is placed has an origin on the Earth");
  read_through(*placed);
}

}  // namespace stillmap::fuzz
