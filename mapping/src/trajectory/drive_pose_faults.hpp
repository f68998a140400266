#pragma once

#include "trajectory/pose_faults.hpp"

#include <stillmap/mapping/odometry.hpp>
#include <stillmap/maps/drive.hpp>

#include <cstddef>
#include <span>

namespace stillmap::mapping {

/// @param begin     scan of the first pose of odometry.
[[nodiscard]] PathPair paths_of(const maps::Drive& drive, std::size_t begin,
                                std::span<const OdometryPose> odometry);

/// Faults of a drive's own poses. Reads a scan where motion leaves mirrored axes open.
[[nodiscard]] PoseFaults faults_of(const maps::Drive& drive, std::size_t begin,
                                   std::span<const OdometryPose> odometry);

}  // namespace stillmap::mapping
