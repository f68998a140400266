#include "pipeline/place_stage.hpp"

#include "core/ordered_pipeline.hpp"
#include "pipeline/build.hpp"

#include <utility>

namespace stillmap::mapping {
namespace {

/// Some 80 bytes each: 400 MiB. A street of the town has some 5,000 voxels of 0.1 m a metre.
constexpr std::size_t kMostVoxels = 5'000'000;

}  // namespace

std::vector<maps::MapManifest::DriveCounts> drive_counts(const DriveSet& drives,
                                                         const BuildObjects& objects) {
  std::vector<maps::MapManifest::DriveCounts> counts;
  for (const maps::Trajectory& drive : drives.trajectories())
    counts.push_back({.scans = static_cast<std::uint32_t>(drive.size()), .objects = 0});
  for (const FusedObject& object : objects.objects)
    ++counts[drives.place(object.placements.front().scan).drive].objects;
  return counts;
}

Placed::Placed(const std::filesystem::path& scratch) : stack(scratch / "tiles", kMostVoxels) {}

void place_scans(Build& build) {
  const DriveSet& drives = *build.drives;
  const Survey& survey = *build.survey;
  const BuildObjects& objects = build.objects;
  const BuildTask& task = build.task;
  build.placed = std::make_unique<Placed>(task.scratch);
  Placed& placed = *build.placed;
  if (task.cleaner != nullptr) placed.in_object.emplace(task.scratch);
  const FusedGround* ground = task.options.fusion ? &survey.ground : nullptr;
  task.writer->set_drives(drive_counts(drives, objects));
  const PosedViews views = posed_views(drives, survey, build.grid->origin());
  std::size_t done = 0;
  process_in_order(
      drives.size(), task.options.threads,
      [&](std::size_t scan) {
        return build.scan_work->place(
            {scan, survey.found(scan), objects.by_scan[scan], objects.kept_by_scan[scan]}, ground,
            views);
      },
      [&](PlacedScan scan) {
        {
          const StageTimer timer(scan.stage_seconds, "stack");
          placed.stack.add(scan.voxels);
        }
        task.writer->add_fates(scan.fates);
        if (placed.in_object) placed.in_object->append(scan.in_object);
        add_to(placed.points_removed, scan.points_removed);
        add_to(build.result.points, scan.counts);
        add_to(build.result.stage_seconds, scan.stage_seconds);
        if (++done % kRestScans == 0) survey.ground.rest();
        build.tell("place", done, drives.size());
      },
      task.cancel);
}

}  // namespace stillmap::mapping
