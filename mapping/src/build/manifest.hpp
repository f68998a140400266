#pragma once

#include "build/drive_set.hpp"

#include <stillmap/mapping/map_build.hpp>
#include <stillmap/mapping/trajectory.hpp>
#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>

#include <map>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// What a map takes over from the one that it is registered to.
struct BuildFrame {
  std::string frame_id;
  /// Of the tiles, so that they are the same cells of the same places [m].
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  maps::Registration registration;
};

/// What the digest covers, without tiles and files: nothing of time, host or threads is in it.
/// @param odometry  `given` or the method that made the poses.
/// @param frame     of a map that is registered to another.
[[nodiscard]] maps::MapManifest manifest_of(const DriveSet& drives, const MapBuildOptions& options,
                                            const std::string& odometry,
                                            const std::optional<BuildFrame>& frame,
                                            const Eigen::Vector3d& origin,
                                            const MapBuildReport& report);

/// Every option that decides the map, as text; those of the poses apart.
[[nodiscard]] std::map<std::string, std::string> texts_of(const MapBuildOptions& options);
/// Names of drives, and checksums of the files that options name. @throws maps::StorageError.
[[nodiscard]] std::map<std::string, std::string> sources_of(const std::vector<maps::Drive>& drives,
                                                            const MapBuildOptions& options);
/// What is asked for of odometry, loops and graph, by name.
[[nodiscard]] std::map<std::string, std::string> texts_of(const TrajectoryOptions& options);

}  // namespace stillmap::mapping
