#pragma once

#include "drives/drive_set.hpp"
#include "fusion/obstacle_store.hpp"
#include "ground/fused_ground.hpp"
#include "pipeline/scan_work.hpp"
#include "views/posed_views.hpp"
#include "views/range_view_store.hpp"

#include <stillmap/maps/box.hpp>

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// What was found scan by scan.
struct Survey {
  struct Scan : FoundInScan {
    std::vector<maps::Box> boxes;
  };
  /// `scratch` is a folder.
  explicit Survey(const std::filesystem::path& scratch) : obstacles(scratch), views(scratch) {}

  /// By ordinal.
  std::vector<Scan> scans;
  FusedGround ground;
  ObstacleStore obstacles;
  RangeViewStore views;
  /// SHA-256 and name of every scan's file, a line each as `sha256sum` prints it.
  std::string sources;
  /// Scans that were taken from the journal.
  std::size_t resumed = 0;
  Counts counts;
  /// Of such scans too: what they took in the build that was killed.
  StageSeconds stage_seconds;
};

/// The views of all scans with their poses. @param views  must outlive what is returned.
[[nodiscard]] PosedViews posed_views(const DriveSet& drives, const RangeViewStore& views,
                                     const Eigen::Vector3d& origin);

}  // namespace stillmap::mapping
