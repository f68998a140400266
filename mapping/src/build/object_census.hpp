#pragma once

#include <stillmap/maps/map_package.hpp>

#include <cstddef>
#include <vector>

namespace stillmap::mapping {

/// How many different objects a drive's boxes belong to.
struct ObjectCensus {
  /// Seen in at least 3 scans, and never farther than 1 m from where they were first seen.
  std::size_t parked = 0;
  /// Seen in at least 3 scans, and farther than that.
  std::size_t moving = 0;
  /// Seen in fewer scans: cannot be told.
  std::size_t brief = 0;
};

/// Joins boxes over time: by their track number where they have one, else each box to the nearest
/// object that was seen within the last 5 scans of the list and not more than 2.5 m away.
/// @param objects  in the order of the scans.
[[nodiscard]] ObjectCensus census_of(const std::vector<maps::MapObject>& objects);

}  // namespace stillmap::mapping
