#pragma once

#include "fuzz_folder.hpp"
#include "scan_rules.hpp"

#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/error.hpp>

namespace stillmap::fuzz {

/// Opens the file as a drive and reads all its scans.
inline void drive_through(const std::filesystem::path& file) {
  const auto drive =
      taken<maps::InputError, maps::StorageError>([&] { return maps::Drive::open(file); });
  if (!drive) return;
  const auto& stamps = drive->contents().stamps_ns;
  for (std::size_t i = 0; i < drive->size(); ++i) {
    require(i == 0 || stamps[i] > stamps[i - 1], "stamps increase");
    if (drive->has_poses()) require(drive->T_map_lidar(i).matrix().allFinite(), "poses are finite");
    const auto scan = taken<maps::InputError, maps::StorageError>([&] { return drive->read(i); });
    if (scan) require_whole(scan->cloud);
  }
}

}  // namespace stillmap::fuzz
