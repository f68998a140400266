#include "pipeline/finish_stage.hpp"

#include "pipeline/build.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <cstddef>
#include <map>
#include <vector>

namespace stillmap::mapping {
namespace {

/// The drives' scans for cleaning methods that read them again.
class DriveScans final : public ScanSource {
 public:
  explicit DriveScans(const Build& build) : build_(build) {}

  [[nodiscard]] std::size_t size() const override { return build_.drives->size(); }
  [[nodiscard]] Eigen::Isometry3d T_local_lidar(std::size_t scan) const override {
    Eigen::Isometry3d T = build_.drives->T_map_scan(scan);
    T.translation() -= build_.grid->origin();
    return T;
  }
  [[nodiscard]] PosedScan read(std::size_t scan) const override {
    Counts unused;
    const std::vector<bool> ground = build_.survey->is_ground.read(scan);
    const std::vector<bool> object = build_.placed->in_object.value().read(scan);
    return {T_local_lidar(scan),
            build_.drives->read(scan, unused).cloud.positions,
            {ground.begin(), ground.end()},
            {object.begin(), object.end()}};
  }

 private:
  const Build& build_;
};

MovedPoints moved_in_whole(const Build& build, const Cleaner& cleaner) {
  const VoxelGrid& grid = *build.grid;
  const TileStack& stack = build.placed->stack;
  CleaningPoints all;
  all.voxel_size_m = grid.voxel_size_m();
  std::map<maps::TileId, std::size_t> sizes;
  for (const maps::TileId id : stack.tiles()) {
    std::vector<std::size_t> unused;
    const CleaningPoints points = cleaning_points(grid, id, stack.read(id), unused);
    all.positions.insert(all.positions.end(), points.positions.begin(), points.positions.end());
    all.is_ground.insert(all.is_ground.end(), points.is_ground.begin(), points.is_ground.end());
    all.scans.insert(all.scans.end(), points.scans.begin(), points.scans.end());
    sizes[id] = points.positions.size();
  }
  const std::vector<std::uint8_t> moved =
      cleaner.moved(all, DriveScans(build), build.task.progress, build.task.cancel);
  MovedPoints by_tile;
  auto at = moved.begin();
  for (const auto& [id, size] : sizes) {
    const auto end = at + static_cast<std::ptrdiff_t>(size);
    by_tile[id].assign(at, end);
    at = end;
  }
  return by_tile;
}

const std::vector<maps::TileId>& require_some(const std::vector<maps::TileId>& ids,
                                              const BuildTask& task) {
  if (!ids.empty()) return ids;
  throw maps::InputError(
      task.drives.front().contents().root.string(), "no usable point in any selected scan",
      "at least one scan with points in range: check --select, --min-range and --max-range");
}

}  // namespace

MapOfTiles::MapOfTiles(Build& build, const std::vector<maps::TileId>& ids)
    : build_(build),
      preview_(TopView::of_tiles(require_some(ids, build.task))),
      tiles_(ids.size()) {
  for (const char* count : {"cleaned", "filled", "static"}) build.result.points[count] = 0;
}

void MapOfTiles::take(const FinishedTile& finished) {
  MapBuildResult& result = build_.result;
  consistency_.add(finished.consistency);
  add_to(result.points, finished.counts);
  add_to(result.stage_seconds, finished.stage_seconds);
  const maps::MapTile tile = finished.tile.placed(build_.grid->origin());
  result.points["static"] += tile.size();
  for (const maps::MapPoint& p : tile) preview_.add_point(tile.from_origin(p));
  if (!tile.empty())
    build_.task.writer->add_tile(finished.tile.id, tile, finished.tile.history, finished.evidence);
  build_.tell("tiles", ++taken_, tiles_);
}

void MapOfTiles::finish() {
  preview_.write_png(build_.task.writer->folder() / "preview.png");
  build_.result.consistency = consistency_.result();
}

void finish_tiles(Build& build) {
  const BuildTask& task = build.task;
  TileStack& stack = build.placed->stack;
  const std::vector<maps::TileId> ids = stack.tiles();
  MapOfTiles map(build, ids);
  MovedPoints moved;
  if (task.cleaner != nullptr) {
    const StageTimer timer(build.result.stage_seconds, "clean");
    moved = moved_in_whole(build, *task.cleaner);
  }
  finish_regions(build, regions_of(ids), stack, task.cleaner != nullptr ? &moved : nullptr,
                 [&](const FinishedTile& tile) { map.take(tile); });
  map.finish();
}

}  // namespace stillmap::mapping
