#include "pipeline/tile_work.hpp"

#include "cleaning/free_space_cleaner.hpp"
#include "cleaning/seen_cubes.hpp"
#include "core/ordered_pipeline.hpp"
#include "ground/ground_fill.hpp"
#include "pipeline/tile_window.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Drops the voxels that a cleaner flagged. @param numbers  of the flags' voxels in `sums`.
std::size_t drop(std::vector<VoxelSum>& sums, const std::vector<std::size_t>& numbers,
                 const std::uint8_t* moved) {
  std::vector<std::uint8_t> goes(sums.size(), 0);
  for (std::size_t i = 0; i < numbers.size(); ++i) goes[numbers[i]] = moved[i];
  std::size_t kept = 0;
  for (std::size_t i = 0; i < sums.size(); ++i) {
    if (goes[i] == 0) sums[kept++] = sums[i];
  }
  const std::size_t dropped = sums.size() - kept;
  sums.resize(kept);
  return dropped;
}

/// By scan.
std::vector<std::size_t> drives_of(const DriveSet& drives) {
  std::vector<std::size_t> of_scan;
  for (std::size_t scan = 0; scan < drives.size(); ++scan)
    of_scan.push_back(drives.place(scan).drive);
  return of_scan;
}

/// Whole metres, below which hardly a point of a tile lies: single ones are mirror images.
std::int32_t lowest_m(const std::vector<maps::MapPoint>& points) {
  std::vector<float> heights;
  for (const maps::MapPoint& p : points) heights.push_back(p.z);
  const auto low = heights.begin() + static_cast<std::ptrdiff_t>(heights.size() / 20);
  std::nth_element(heights.begin(), low, heights.end());
  return static_cast<std::int32_t>(std::floor(*low));
}

/// What is done to one tile. Safe from several threads, for different tiles.
class TileWork {
 public:
  explicit TileWork(const Build& build)
      : grid_(*build.grid),
        options_(build.task.options),
        ground_(build.survey->ground),
        views_(posed_views(*build.drives, *build.survey, grid_.origin())),
        seen_(views_, drives_of(*build.drives)) {
    if (options_.clean == "free-space") keyframes_ = select_keyframes(views_.T_local_lidar);
    for (const maps::Edit& edit : build.task.edits) {
      if (edit.action != maps::EditAction::kKeep || !edit.box) continue;
      kept_.push_back(*edit.box);
      kept_.back().centre -= grid_.origin();
    }
    if (!options_.fills_ground()) return;
    const std::vector<FusedObject>& objects = build.objects.objects;
    footprints_ = footprints_of(objects, grid_.origin());
    for (std::size_t i = 0; i < objects.size(); ++i) {
      if (!objects[i].moving) numbers_.push_back(static_cast<std::uint32_t>(i + 1));
    }
  }

  /// @param moved  what a method for the whole map said; nullptr = ours or none.
  [[nodiscard]] FinishedTile finish(maps::TileId id, TileWindow& window,
                                    const std::vector<std::uint8_t>* moved) const {
    FinishedTile out;
    OpenTile& open = window.tile(id);
    if (moved != nullptr) {
      clean(open, *moved, out);
    } else if (options_.clean == "free-space") {
      const StageTimer timer(out.stage_seconds, "clean");
      clean(open,
            moved_by_free_space(window.with_rim(id, free_space_rim_m(grid_.voxel_size_m())),
                                area_of(id), views_, keyframes_),
            out);
    }
    {
      const StageTimer timer(out.stage_seconds, "finish");
      out.tile = to_points(grid_, id, open.sums, [this](std::uint32_t scan) {
        return Eigen::Vector3f(views_.T_local_lidar[scan].translation().cast<float>());
      });
    }
    if (!footprints_.empty()) fill(out);
    if (!out.tile.points.empty()) {
      const StageTimer timer(out.stage_seconds, "evidence");
      out.evidence = seen_.of(id, lowest_m(out.tile.points));
    }
    open.sums = {};
    {
      const StageTimer timer(out.stage_seconds, "consistency");
      out.consistency.add(
          surface_cells(surface_points(id, out.tile.placed(grid_.origin())), grid_.voxel_size_m()));
    }
    return out;
  }

 private:
  /// @param moved  a flag for each of the tile's points, more are passed over.
  void clean(OpenTile& open, std::vector<std::uint8_t> moved, FinishedTile& out) const {
    for (std::size_t i = 0; !kept_.empty() && i < open.numbers.size(); ++i) {
      const Eigen::Vector3d p = open.points.positions[i].cast<double>();
      if (std::any_of(kept_.begin(), kept_.end(),
                      [&](const maps::Box& box) { return box.contains(p); }))
        moved[i] = 0;
    }
    out.counts["cleaned"] = drop(open.sums, open.numbers, moved.data());
  }

  void fill(FinishedTile& out) const {
    const StageTimer timer(out.stage_seconds, "fill");
    const std::vector<Eigen::Vector3d> filled = fill_ground(
        out.tile.id, out.tile.placed(grid_.origin()), footprints_, ground_, grid_.voxel_size_m());
    for (const Eigen::Vector3d& p : filled) {
      const auto under = std::find_if(
          footprints_.begin(), footprints_.end(),
          [&](const GroundFootprint& footprint) { return footprint.covers(p.head<2>()); });
      const bool known = under != footprints_.end();
      add_filled(p, known ? numbers_[static_cast<std::size_t>(under - footprints_.begin())] : 0,
                 out.tile);
    }
    out.counts["filled"] = filled.size();
  }

  const VoxelGrid& grid_;
  const MapBuildOptions& options_;
  const FusedGround& ground_;
  /// Regions in which nothing is cleaned; local frame.
  std::vector<maps::Box> kept_;
  PosedViews views_;
  SeenCubes seen_;
  std::vector<Keyframe> keyframes_;
  std::vector<GroundFootprint> footprints_;
  /// Number of each footprint's object plus 1.
  std::vector<std::uint32_t> numbers_;
};

}  // namespace

std::vector<RegionTiles> regions_of(const std::vector<maps::TileId>& ids) {
  std::map<maps::RegionId, RegionTiles> regions;
  for (const maps::TileId id : ids) regions[maps::region_of(id)].own.push_back(id);
  for (const maps::TileId id : ids) {
    std::set<RegionTiles*> touched;
    for (int step = 0; step < 9; ++step) {
      const auto found =
          regions.find(maps::region_of({id.level, id.x + step % 3 - 1, id.y + step / 3 - 1}));
      if (found != regions.end()) touched.insert(&found->second);
    }
    for (RegionTiles* region : touched) {
      region->with_rim.push_back(id);
      if (touched.size() > 1) region->shared.insert(id);
    }
  }
  std::vector<RegionTiles> in_order;
  for (auto& [region, tiles] : regions) in_order.push_back(std::move(tiles));
  return in_order;
}

void finish_regions(const Build& build, const std::vector<RegionTiles>& regions, TileStack& stack,
                    const MovedPoints* moved,
                    const std::function<void(const FinishedTile&)>& take) {
  const int threads = build.task.options.threads;
  const TileWork work(build);
  for (const RegionTiles& region : regions) {
    build.survey->ground.rest();
    TileWindow window(stack, *build.grid, region.with_rim, region.shared);
    for (auto begin = region.own.begin(); begin != region.own.end();) {
      const std::int32_t x = begin->x;
      const auto end =
          std::find_if(begin, region.own.end(), [x](const auto& id) { return id.x != x; });
      window.move_to(x, threads);
      process_in_order(
          static_cast<std::size_t>(end - begin), threads,
          [&](std::size_t i) {
            const maps::TileId id = begin[static_cast<std::ptrdiff_t>(i)];
            return work.finish(id, window, moved != nullptr ? &moved->at(id) : nullptr);
          },
          take, build.task.cancel);
      begin = end;
    }
  }
}

}  // namespace stillmap::mapping
