#pragma once

#include <stillmap/maps/map_package.hpp>

#include <filesystem>

namespace stillmap::mapping {

/// Writes a copy of a map in which every point counts as measured: what is left of it when it is
/// kept as a plain cloud. Trajectories are kept; normals, objects and what became of the scans'
/// points are not.
/// @throws maps::InputError, maps::StorageError.
void write_plain_map(const maps::MapPackage& map, const std::filesystem::path& target);

}  // namespace stillmap::mapping
