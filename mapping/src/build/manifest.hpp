#pragma once

#include "build/drive_set.hpp"

#include <stillmap/mapping/map_build.hpp>
#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>

namespace stillmap::mapping {

/// What the digest covers, without tiles and files: nothing of time, host or threads is in it.
[[nodiscard]] maps::MapManifest manifest_of(const DriveSet& drives, const MapBuildOptions& options,
                                            const Eigen::Vector3d& origin,
                                            const MapBuildReport& report);

}  // namespace stillmap::mapping
