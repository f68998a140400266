#pragma once

#include "core/flag_store.hpp"
#include "drives/drive_set.hpp"
#include "stacking/tile_stack.hpp"

#include <stillmap/maps/map_package.hpp>

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <vector>

namespace stillmap::mapping {

/// The points of the map, tile by tile, and what became of those of each scan.
struct Placed {
  explicit Placed(const std::filesystem::path& scratch);

  TileStack stack;
  /// By ordinal of the scan, one a point of the scan as `DriveSet::read` gives it: whether it was
  /// projected or deleted. Only with a method that needs the whole map at once.
  std::optional<FlagStore> in_object;
  /// By number of the object plus 1.
  std::map<std::uint32_t, std::uint64_t> points_removed;
};

struct BuildObjects;

/// Scans and objects of each drive.
[[nodiscard]] std::vector<maps::MapManifest::DriveCounts> drive_counts(const DriveSet& drives,
                                                                       const BuildObjects& objects);

}  // namespace stillmap::mapping
