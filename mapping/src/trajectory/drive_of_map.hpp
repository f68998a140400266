#pragma once

#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/trajectory.hpp>

#include <cstddef>
#include <optional>
#include <vector>

namespace stillmap::mapping {

/// A drive that a map was made of.
struct DriveOfMap {
  maps::Trajectory path;
  /// Number in the map of the path's first scan.
  std::size_t first_ordinal = 0;
  /// Index in the drive of each of the path's scans, ascending.
  std::vector<std::size_t> scans;
};

/// The drive among those of the map, by the stamps and the checksums of its scans.
[[nodiscard]] std::optional<DriveOfMap> find_in_map(const maps::MapPackage& map,
                                                    const maps::Drive& drive);

/// The drive where a map has it, which need not be where its own poses say: scans of the path get
/// the path's poses; a scan between two of them lies there by its time where they are half a second
/// apart or less and the path does not move between them as the drive's own poses do, or the drive
/// has no poses; else it keeps its own motion to both. Scans before the first and behind the last
/// follow these, or get their poses.
[[nodiscard]] maps::Drive on_path(const maps::Drive& drive, const maps::Trajectory& path);

}  // namespace stillmap::mapping
