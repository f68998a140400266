#pragma once

#include "drives/drive_set.hpp"
#include "registration/build_frame.hpp"

#include <stillmap/mapping/map_build.hpp>
#include <stillmap/mapping/trajectory.hpp>
#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>

#include <map>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// What the digest covers, without tiles and files: nothing of time, host or threads is in it.
/// @param odometry  `given` or the method that made the poses.
/// @param frame     of a map that is registered to another.
[[nodiscard]] maps::MapManifest manifest_of(const DriveSet& drives, const MapBuildOptions& options,
                                            const std::string& odometry,
                                            const std::optional<BuildFrame>& frame,
                                            const Eigen::Vector3d& origin,
                                            const MapBuildResult& report);

/// Every option that decides the map, as text; those of the poses apart.
[[nodiscard]] std::map<std::string, std::string> texts_of(const MapBuildOptions& options);
/// Names of drives, and checksums of the files that options name. @throws maps::StorageError.
[[nodiscard]] std::map<std::string, std::string> sources_of(const std::vector<maps::Drive>& drives,
                                                            const MapBuildOptions& options);
/// What is asked for of odometry, loops and graph, by name.
[[nodiscard]] std::map<std::string, std::string> texts_of(const TrajectoryOptions& options);

}  // namespace stillmap::mapping
