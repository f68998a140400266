#pragma once

#include <stillmap/mapping/odometry.hpp>

#include <memory>

namespace stillmap::mapping {

/// The method `loam`: edges and planes of each sweep against those of the sweep before, then
/// against the map of all before.
/// @see Zhang and Singh, "LOAM: Lidar Odometry and Mapping in Real-time", RSS 2014; equation
/// numbers stand at what they are. Departures: sweeps are moved to the scan's stamp instead of
/// their end; every sweep, not every tenth, is matched with the map; the map is a hash table of
/// voxels instead of cubes with a kd-tree for each scan; a whole turn has six sectors; rings are
/// estimated.
/// @note Refuses sensors without rings (`maps::InputError` from `prepare`).
[[nodiscard]] std::unique_ptr<Odometry> make_loam();

}  // namespace stillmap::mapping
