#pragma once

#include <stillmap/mapping/map_build.hpp>
#include <stillmap/maps/drive.hpp>

#include <string>
#include <string_view>
#include <vector>

namespace stillmap::mapping {

struct Build;

/// The key of the survey's journal: everything that decides what is found in a scan but the scan's
/// own file, a line each: the program's and its libraries' code, the instruction set, options and
/// the files that they name, the drives' stamps and poses, the map that it is registered to, and
/// the scans that the survey learns from, whose files are read.
/// @param build  with its selected scans.
/// @throws maps::StorageError naming a file.
[[nodiscard]] std::string survey_key(const Build& build);

/// The key of the journal of the poses: the program's code and instruction set, what odometry,
/// loops and graph are asked for, the drives' stamps and own poses, and size and time of change of
/// each scan's file: to read them all would take as long as much of the work that is saved.
/// @throws maps::StorageError naming a file.
[[nodiscard]] std::string trajectory_key(const std::vector<maps::Drive>& drives,
                                         const MapBuildOptions& options,
                                         const std::string& odometry);

/// The key of the journal of registered poses: as `trajectory_key`, with the map and all options
/// that the survey depends on.
/// @throws as `trajectory_key`; maps::InputError for a map that cannot be opened.
[[nodiscard]] std::string registered_key(const Build& build);

/// The key of a whole rebuild: as `trajectory_key`, with every option of the map and the checksums
/// of the files that options name.
/// @throws maps::StorageError naming a file.
[[nodiscard]] std::string rebuild_key(const std::vector<maps::Drive>& drives,
                                      const MapBuildOptions& options, const std::string& odometry);

/// The first line in which two keys differ, as "found '...', expected '...'".
[[nodiscard]] std::string key_difference(std::string_view found, std::string_view expected);

/// What is loaded into this process when it is first asked for, so that another build of the
/// program or a library is told from this one although both have one version. SHA-256, hex.
[[nodiscard]] std::string running_code();

}  // namespace stillmap::mapping
