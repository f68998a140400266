#pragma once

#include "pipeline/object_pass.hpp"
#include "pipeline/scan_stages.hpp"
#include "pipeline/survey_pass.hpp"
#include "stacking/tile_stack.hpp"

#include <stillmap/mapping/progress.hpp>
#include <stillmap/maps/map_package.hpp>

#include <cstdint>
#include <filesystem>
#include <map>
#include <vector>

namespace stillmap::mapping {

/// What pass 2 leaves behind.
struct Placed {
  explicit Placed(const std::filesystem::path& scratch);

  TileStack stack;
  /// By ordinal of the scan, one a point of the scan as `DriveSet::read` gives it: whether it was
  /// projected or deleted.
  std::vector<std::vector<bool>> in_object;
  /// By number of the object plus 1.
  std::map<std::uint32_t, std::uint64_t> points_removed;
  Counts counts;
  StageSeconds stage_seconds;
};

/// Pass 2 over all scans: several at once, stacked in their order. Fates go to the package.
/// @param ground  none = each scan's own.
[[nodiscard]] std::unique_ptr<Placed> place_scans(const DriveSet& drives, const ScanStages& stages,
                                                  const Survey& survey, const BuildObjects& objects,
                                                  const FusedGround* ground,
                                                  maps::MapPackageWriter& writer,
                                                  const std::filesystem::path& scratch, int threads,
                                                  const ProgressCallback& progress,
                                                  const CancelFlag& cancel);

}  // namespace stillmap::mapping
