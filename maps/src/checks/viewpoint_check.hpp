#pragma once

#include <stillmap/maps/drive_check.hpp>

#include <optional>

namespace stillmap::maps {

/// Of a folder of scans without poses: whether there are any, or the VIEWPOINTs of its PCD files
/// are, and whether the points lie in the map's frame already. VIEWPOINTs are not applied by who
/// reads the scans.
/// @return nothing for other drives. @throws as `Drive::read`.
[[nodiscard]] std::optional<DriveFinding> check_viewpoints(const Drive& drive);

}  // namespace stillmap::maps
