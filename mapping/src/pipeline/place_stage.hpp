#pragma once

#include "stacking/tile_stack.hpp"

#include <cstdint>
#include <filesystem>
#include <map>
#include <vector>

namespace stillmap::mapping {

/// The points of the map, tile by tile, and what became of those of each scan.
struct Placed {
  explicit Placed(const std::filesystem::path& scratch);

  TileStack stack;
  /// By ordinal of the scan, one a point of the scan as `DriveSet::read` gives it: whether it was
  /// projected or deleted.
  std::vector<std::vector<bool>> in_object;
  /// By number of the object plus 1.
  std::map<std::uint32_t, std::uint64_t> points_removed;
};

}  // namespace stillmap::mapping
