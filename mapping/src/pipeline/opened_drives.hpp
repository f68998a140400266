#pragma once

#include <stillmap/mapping/map_build.hpp>
#include <stillmap/maps/drive.hpp>

#include <filesystem>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// @throws maps::InputError for a folder that is no drive; std::invalid_argument for none, or for a
/// poses file with several drives.
[[nodiscard]] std::vector<maps::Drive> open_drives(
    const std::vector<std::filesystem::path>& folders, const MapBuildOptions& options);

/// The drives with so much more added to the stamps of their poses.
/// @param offsets_s  one a drive.
/// @throws as `open_drives`; maps::InputError for a selection, where scans then count from another.
[[nodiscard]] std::vector<maps::Drive> shifted_by(const std::vector<double>& offsets_s,
                                                  const std::vector<std::filesystem::path>& folders,
                                                  const std::vector<maps::Drive>& drives,
                                                  const MapBuildOptions& options);

/// `given`, or the method of odometry that the build uses.
/// @throws std::invalid_argument for an unknown method, and for a prior or GNSS beside `given`;
/// maps::InputError for `given` and a drive without poses.
[[nodiscard]] std::string odometry_of(const std::vector<maps::Drive>& drives,
                                      const MapBuildOptions& options);

/// Whether the poses that the drives bring are used: as they are, or as a prior or GNSS.
/// @param odometry  of `odometry_of`.
[[nodiscard]] bool uses_given_poses(const std::string& odometry, const MapBuildOptions& options);

/// The drives' own poses, brought to the frame of the first drive's by their geodetic origins.
/// @throws maps::InputError where only some have an origin.
[[nodiscard]] std::vector<maps::Drive> in_one_frame(const std::vector<maps::Drive>& drives);

}  // namespace stillmap::mapping
