#pragma once

#include <stillmap/mapping/map_build.hpp>
#include <stillmap/mapping/trajectory.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/map_package.hpp>

#include <map>
#include <string>
#include <vector>

namespace stillmap::mapping {

struct Build;

/// What the digest covers, without tiles and files: nothing of time, host or threads is in it.
/// @param build  with its selected scans; counts are those that it has so far.
[[nodiscard]] maps::MapManifest manifest_of(const Build& build);

/// Every option that decides the map, as text; those of the poses apart.
[[nodiscard]] std::map<std::string, std::string> texts_of(const MapBuildOptions& options);
/// Names of drives, and checksums of the files that options name. @throws maps::StorageError.
[[nodiscard]] std::map<std::string, std::string> sources_of(const std::vector<maps::Drive>& drives,
                                                            const MapBuildOptions& options);
/// What is asked for of odometry, loops and graph, by name.
[[nodiscard]] std::map<std::string, std::string> texts_of(const TrajectoryOptions& options);

}  // namespace stillmap::mapping
