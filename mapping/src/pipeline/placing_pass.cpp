#include "pipeline/placing_pass.hpp"

#include "core/ordered_pipeline.hpp"

#include <utility>

namespace stillmap::mapping {
namespace {

/// Some 80 bytes each: 400 MiB. A street of the town has some 5,000 voxels of 0.1 m a metre.
constexpr std::size_t kMostVoxels = 5'000'000;

}  // namespace

Placed::Placed(const std::filesystem::path& scratch) : stack(scratch / "tiles", kMostVoxels) {}

std::unique_ptr<Placed> place_scans(const DriveSet& drives, const ScanStages& stages,
                                    const Survey& survey, const BuildObjects& objects,
                                    const FusedGround* ground, maps::MapPackageWriter& writer,
                                    const std::filesystem::path& scratch, int threads,
                                    const ProgressCallback& progress, const CancelFlag& cancel) {
  auto placed = std::make_unique<Placed>(scratch);
  const PosedViews views = posed_views(drives, survey.views, stages.origin());
  process_in_order(
      drives.size(), threads,
      [&](std::size_t scan) {
        return stages.place(scan, survey.scans[scan], objects.by_scan[scan],
                            objects.kept_by_scan[scan], ground, views);
      },
      [&](PlacedScan scan) {
        {
          const StageTimer timer(scan.stage_seconds, "stack");
          placed->stack.add(scan.voxels);
        }
        writer.add_fates(scan.fates);
        placed->in_object.push_back(std::move(scan.in_object));
        add_to(placed->points_removed, scan.points_removed);
        add_to(placed->counts, scan.counts);
        add_to(placed->stage_seconds, scan.stage_seconds);
        if (progress) progress("place", placed->in_object.size(), drives.size());
      },
      cancel);
  return placed;
}

}  // namespace stillmap::mapping
