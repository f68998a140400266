#pragma once

#include "drives/drive_set.hpp"
#include "pipeline/graph_of_poses.hpp"
#include "views/posed_views.hpp"

#include <stillmap/mapping/map_build.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/drive_check.hpp>

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// @throws maps::InputError for a folder that is no drive; std::invalid_argument for none, or for a
/// poses file with several drives.
[[nodiscard]] std::vector<maps::Drive> open_drives(
    const std::vector<std::filesystem::path>& folders, const MapBuildOptions& options);

/// What the scans' motion says is to be added to the stamps of each drive's poses [s]; 0 where it
/// tells nothing. Runs odometry over the selected scans.
/// @param drives  as `open_drives` gives them.
/// @throws Cancelled.
[[nodiscard]] std::vector<double> found_pose_time_offsets(const std::vector<maps::Drive>& drives,
                                                          const MapBuildOptions& options,
                                                          const ProgressCallback& progress,
                                                          const CancelFlag& cancel);

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

/// Drives whose poses are in one frame, and what was counted on the way.
struct PosedDrives {
  std::vector<maps::Drive> drives;
  std::map<std::string, std::uint64_t> counts;
  /// Of poses that were estimated or refined.
  std::optional<DriveGraph> graph{};
  /// Of poses that the drives bring.
  std::optional<GivenPosesResult> given{};
  /// Of poses that the drives bring and that were used.
  std::vector<maps::DriveFinding> faults{};
  /// One a scan of each drive, 0 outside of the selection: what cleaning allows for.
  std::vector<std::vector<maps::PoseDisagreement>> doubts{};
  /// As many: of the poses as they are used, with the scans' own motion.
  std::vector<std::vector<maps::PoseDisagreement>> disagreements{};
  /// As many; none outside of the selection.
  std::vector<std::vector<ScanNote>> notes{};
};

/// The drives' own poses, brought to the frame of the first drive's by their geodetic origins.
/// @throws maps::InputError where only some have an origin.
[[nodiscard]] std::vector<maps::Drive> in_one_frame(const std::vector<maps::Drive>& drives);

/// The drives' own poses in one frame, compared with the scans' own motion, and refined where the
/// options say so.
/// @param applied_offsets_s  what was added to the stamps of each drive's poses.
/// @param scratch  existing folder.
/// @throws as `in_one_frame`, Cancelled.
[[nodiscard]] PosedDrives with_given_poses(const std::vector<maps::Drive>& drives,
                                           const MapBuildOptions& options,
                                           std::span<const double> applied_offsets_s,
                                           const std::filesystem::path& scratch,
                                           const ProgressCallback& progress,
                                           const CancelFlag& cancel);

/// Poses by odometry, loops and graph. Scans before the selection and after it have none of use.
/// @param method   of `odometry_of`.
/// @param applied_offsets_s  as in `with_given_poses`.
/// @param scratch  existing folder.
[[nodiscard]] PosedDrives with_estimated_poses(const std::vector<maps::Drive>& drives,
                                               const MapBuildOptions& options,
                                               const std::string& method,
                                               std::span<const double> applied_offsets_s,
                                               const std::filesystem::path& scratch,
                                               const ProgressCallback& progress,
                                               const CancelFlag& cancel);

}  // namespace stillmap::mapping
