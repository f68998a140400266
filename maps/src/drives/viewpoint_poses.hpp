#pragma once

#include <stillmap/maps/drive.hpp>

#include <optional>

#include "drives/points_frame.hpp"

namespace stillmap::maps {

/// Takes the VIEWPOINTs of a folder's PCD files as the poses of its scans, if all files have one,
/// they differ, and scans overlap better with them than without; notes say so. Points may lie in
/// the sensor's frame (PCL's convention) or in the frame of the VIEWPOINTs, as
/// DynamicMap_Benchmark writes them: told apart by the scans' overlap, unless `points` is chosen.
/// @throws as `Drive::read` and `read_points_from_map`.
void set_poses_of_viewpoints(Drive::Contents& contents, const std::optional<PointsFrame>& points);

}  // namespace stillmap::maps
