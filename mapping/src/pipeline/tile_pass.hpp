#pragma once

#include "drives/drive_set.hpp"
#include "pipeline/object_pass.hpp"
#include "pipeline/placing_pass.hpp"
#include "pipeline/survey_pass.hpp"
#include "stacking/tile_points.hpp"

#include <stillmap/mapping/cleaning.hpp>
#include <stillmap/mapping/map_build.hpp>
#include <stillmap/mapping/progress.hpp>
#include <stillmap/maps/edits.hpp>
#include <stillmap/maps/map_package.hpp>

#include <cstdint>
#include <vector>

namespace stillmap::mapping {

/// What the last pass counted.
struct TileCounts {
  Counts counts;
  StageSeconds stage_seconds;
  MapConsistency consistency;
};

/// Cleans, fills and finishes all tiles, several at once, and writes them and the preview to the
/// package.
/// @param edits    in regions that are to be kept nothing is cleaned.
/// @param cleaner  a method that needs the whole map at once; nullptr = `options.clean` is ours or
/// none.
/// @throws maps::InputError when no point is left.
[[nodiscard]] TileCounts finish_tiles(const DriveSet& drives, const Survey& survey,
                                      const BuildObjects& objects, Placed& placed,
                                      const VoxelGrid& grid, const MapBuildOptions& options,
                                      const maps::Edits& edits, const Cleaner* cleaner,
                                      maps::MapPackageWriter& writer,
                                      const ProgressCallback& progress, const CancelFlag& cancel);

}  // namespace stillmap::mapping
