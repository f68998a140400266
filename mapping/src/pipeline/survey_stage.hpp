#pragma once

#include "core/flag_store.hpp"
#include "drives/drive_set.hpp"
#include "fusion/obstacle_store.hpp"
#include "ground/fused_ground.hpp"
#include "pipeline/scan_work.hpp"
#include "views/posed_views.hpp"
#include "views/range_view_store.hpp"

#include <stillmap/maps/box.hpp>

#include <cstddef>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// After so many scans a build has gone some hundred metres on.
inline constexpr std::size_t kRestScans = 256;

/// What was found scan by scan.
struct Survey {
  /// `scratch` is a folder.
  explicit Survey(const std::filesystem::path& scratch);
  // Its functions refer to it.
  Survey(const Survey&) = delete;
  Survey& operator=(const Survey&) = delete;

  /// By ordinal of the scan.
  std::vector<std::vector<maps::Box>> boxes;
  std::size_t box_count = 0;
  /// Flags as in `FoundInScan`.
  FlagStore is_ground, weather;
  FusedGround ground;
  ObstacleStore obstacles;
  RangeViewStore views;
  /// Flags and view of a scan: out of the stores above, or wherever a unit finds them. Safe from
  /// several threads.
  std::function<FoundInScan(std::size_t scan)> found;
  std::function<std::shared_ptr<const RangeView>(std::size_t scan)> view;
  /// SHA-256 and name of every scan's file, a line each as `sha256sum` prints it.
  std::string sources;
  /// Scans that were taken from the journal.
  std::size_t resumed = 0;
  Counts counts;
  /// Of such scans too: what they took in the build that was killed.
  StageSeconds stage_seconds;
};

/// The views of all scans with their poses. @param survey  must outlive what is returned.
[[nodiscard]] PosedViews posed_views(const DriveSet& drives, const Survey& survey,
                                     const Eigen::Vector3d& origin);

}  // namespace stillmap::mapping
