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
  /// What odometry says for people.
  std::vector<std::string> remarks{};
};

}  // namespace stillmap::mapping
