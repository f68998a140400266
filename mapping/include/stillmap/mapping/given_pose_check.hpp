#pragma once

#include <stillmap/mapping/progress.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/drive_check.hpp>

#include <span>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// What looks wrong with given poses by the motion that odometry finds in the scans: clocks that
/// are apart, mirrored axes, a scale, a frame that is not the lidar's (mapping/given_poses.md).
/// @param scans   the drive; odometry runs over all its scans and does not use the poses.
/// @param posed   the same drive with poses; it may have fewer scans.
/// @param guided  odometry runs for each of `posed` instead, and starts at its poses, as in a
/// build.
/// @return one list of findings for each of `posed`; empty for those without poses.
/// @throws what reading the scans throws; maps::InputError for a scan of `posed` that is not in
/// `scans`; Cancelled.
[[nodiscard]] std::vector<std::vector<maps::DriveFinding>> check_given_poses(
    const maps::Drive& scans, std::span<const maps::Drive> posed, bool guided,
    const ProgressCallback& progress, const CancelFlag& cancel);

/// A list of objects with code, what and remedy.
[[nodiscard]] std::string to_json(std::span<const maps::DriveFinding> findings);

}  // namespace stillmap::mapping
