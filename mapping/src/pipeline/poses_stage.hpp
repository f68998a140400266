#pragma once

#include "drives/drive_set.hpp"
#include "pipeline/graph_of_poses.hpp"

#include <stillmap/mapping/map_build.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/drive_check.hpp>
#include <stillmap/maps/pose_disagreement.hpp>

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::mapping {

struct Build;

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

/// Stage: shifts given poses in time by what the scans' own motion says (`finds_pose_time_offset`),
/// or a killed build had found.
void shift_poses(Build& build);

/// Stage: poses of all drives in one frame, or those that a killed build had found. Given ones are
/// compared with the scans' own motion, and refined where the options say so; others come from
/// odometry, loops and graph.
void find_poses(Build& build);

/// Stage: moves the poses into the frame of the map that the options name, if they name one.
void register_poses(Build& build);

/// Stage: the selected scans, numbered through, the map's voxels, and where poses disagree.
void select_scans(Build& build);

}  // namespace stillmap::mapping
