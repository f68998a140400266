#include "build/tile_pass.hpp"

#include "build/ordered_pipeline.hpp"
#if __has_include("cleaning/free_space_cleaner.hpp")
#include "cleaning/free_space_cleaner.hpp"
#else
#include "cleaning/free_evidence.hpp"
namespace stillmap::mapping { struct FreeSpaceCleaner { explicit FreeSpaceCleaner(PosedViews){} std::vector<std::uint8_t> moved(const CleaningPoints& p) const { return std::vector<std::uint8_t>(p.positions.size()); } }; }
#endif
#if __has_include("ground/ground_fill.hpp")
#include "ground/ground_fill.hpp"
#else
namespace stillmap::mapping { struct Footprint { maps::Box box; std::uint32_t object; };
inline std::vector<FilledPoint> fill_ground(maps::TileId, const std::vector<Footprint>&, const std::vector<Eigen::Vector3f>&, const FusedGround&, double) { return {}; } }
#endif
#include "top_view.hpp"

#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <limits>
#include <memory>
#include <optional>
#include <utility>

namespace stillmap::mapping {
namespace {

constexpr int kPictureSide = 1600;

/// The drives' scans for cleaning methods that read them again.
class DriveScans final : public ScanSource {
 public:
  DriveScans(const DriveSet& drives, const Survey& survey, const Placed& placed,
             const Eigen::Vector3d& origin)
      : drives_(drives), survey_(survey), placed_(placed), origin_(origin) {}

  [[nodiscard]] std::size_t size() const override { return drives_.size(); }
  [[nodiscard]] Eigen::Isometry3d T_local_lidar(std::size_t scan) const override {
    Eigen::Isometry3d T = drives_.T_map_lidar(scan);
    T.translation() -= origin_;
    return T;
  }
  [[nodiscard]] PosedScan read(std::size_t scan) const override {
    Counts unused;
    const std::vector<bool>& ground = survey_.scans.at(scan).is_ground;
    const std::vector<bool>& object = placed_.in_object.at(scan);
    return {T_local_lidar(scan),
            drives_.read(scan, unused).cloud.positions,
            {ground.begin(), ground.end()},
            {object.begin(), object.end()}};
  }

 private:
  const DriveSet& drives_;
  const Survey& survey_;
  const Placed& placed_;
  Eigen::Vector3d origin_;
};

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

/// All tiles at once through a method that cannot take them one by one.
std::map<maps::TileId, std::vector<VoxelSum>> clean_whole(
    const VoxelGrid& grid, const Cleaner& cleaner, const ScanSource& scans, TileStack& stack,
    Counts& counts, const ProgressCallback& progress, const CancelFlag& cancel) {
  std::map<maps::TileId, std::vector<VoxelSum>> tiles;
  std::map<maps::TileId, std::vector<std::size_t>> numbers;
  CleaningPoints all;
  all.voxel_size_m = grid.voxel_size_m();
  for (const maps::TileId id : stack.tiles()) {
    const std::vector<VoxelSum>& sums = tiles[id] = stack.take(id);
    const CleaningPoints points = cleaning_points(grid, id, sums, numbers[id]);
    all.positions.insert(all.positions.end(), points.positions.begin(), points.positions.end());
    all.is_ground.insert(all.is_ground.end(), points.is_ground.begin(), points.is_ground.end());
    all.scans.insert(all.scans.end(), points.scans.begin(), points.scans.end());
  }
  const std::vector<std::uint8_t> moved = cleaner.moved(all, scans, progress, cancel);
  std::size_t at = 0;
  for (auto& [id, sums] : tiles) {
    counts["cleaned"] += drop(sums, numbers[id], moved.data() + at);
    at += numbers[id].size();
  }
  return tiles;
}

struct FinishedTile {
  TilePoints tile;
  Counts counts;
  StageSeconds stage_seconds;
};

/// What is done to one tile. Safe from several threads, for different tiles.
class TileStages {
 public:
  TileStages(const DriveSet& drives, const Survey& survey, const BuildObjects& objects,
             const VoxelGrid& grid, const MapBuildOptions& options)
      : grid_(grid), options_(options), ground_(survey.ground) {
    for (std::size_t scan = 0; scan < drives.size(); ++scan) {
      Eigen::Isometry3d T = drives.T_map_lidar(scan);
      T.translation() -= grid.origin();
      T_local_lidar_.push_back(T);
    }
    if (options.clean == "free-space")
      free_space_.emplace(PosedViews{
          T_local_lidar_, [&survey](std::size_t scan) { return survey.views.read(scan); }});
    if (options.fusion && options.fill && options.projection.policy != MovablePolicy::kKeep)
      add_footprints(objects.objects);
  }

  [[nodiscard]] FinishedTile finish(maps::TileId id, std::vector<VoxelSum> sums) const {
    FinishedTile out;
    if (free_space_) clean(id, sums, out);
    const std::vector<FilledPoint> filled = fill(id, sums, out);
    const StageTimer timer(out.stage_seconds, "finish");
    out.tile = to_points(grid_, id, sums, filled, [this](std::uint32_t scan) {
      return Eigen::Vector3f(T_local_lidar_[scan].translation().cast<float>());
    });
    return out;
  }

 private:
  void add_footprints(const std::vector<FusedObject>& objects) {
    for (std::size_t i = 0; i < objects.size(); ++i) {
      // What moved left its ground to be seen.
      if (objects[i].moving) continue;
      maps::Box box = objects[i].placements.front().box;
      box.centre -= grid_.origin();
      footprints_.push_back({box, static_cast<std::uint32_t>(i + 1)});
    }
  }

  void clean(maps::TileId id, std::vector<VoxelSum>& sums, FinishedTile& out) const {
    const StageTimer timer(out.stage_seconds, "clean");
    std::vector<std::size_t> numbers;
    const CleaningPoints points = cleaning_points(grid_, id, sums, numbers);
    const std::vector<std::uint8_t> moved = free_space_->moved(points);
    out.counts["cleaned"] = drop(sums, numbers, moved.data());
  }

  [[nodiscard]] std::vector<FilledPoint> fill(maps::TileId id, const std::vector<VoxelSum>& sums,
                                              FinishedTile& out) const {
    if (footprints_.empty()) return {};
    const StageTimer timer(out.stage_seconds, "fill");
    std::vector<Eigen::Vector3f> ground;
    for (const VoxelSum& sum : sums) {
      if (sum.moved() || is_ground(sum)) ground.push_back(mean_of(grid_, id, sum));
    }
    std::vector<FilledPoint> filled =
        fill_ground(id, footprints_, ground, ground_, grid_.voxel_size_m());
    out.counts["filled"] = filled.size();
    return filled;
  }

  const VoxelGrid& grid_;
  const MapBuildOptions& options_;
  const FusedGround& ground_;
  std::vector<Eigen::Isometry3d> T_local_lidar_;
  std::optional<FreeSpaceCleaner> free_space_;
  std::vector<Footprint> footprints_;
};

/// Of whole tiles, since what is in them is not known before.
TopView empty_picture(const std::vector<maps::TileId>& tiles) {
  Eigen::Vector2d min = Eigen::Vector2d::Constant(std::numeric_limits<double>::max());
  Eigen::Vector2d max = -min;
  for (const maps::TileId& id : tiles) {
    const Eigen::Vector2d corner(id.x * maps::kTileSizeM, id.y * maps::kTileSizeM);
    min = min.cwiseMin(corner);
    max = max.cwiseMax(corner + Eigen::Vector2d::Constant(maps::kTileSizeM));
  }
  return {min, max, kPictureSide};
}

}  // namespace

TileCounts finish_tiles(const DriveSet& drives, const Survey& survey, const BuildObjects& objects,
                        Placed& placed, const VoxelGrid& grid, const MapBuildOptions& options,
                        const Cleaner* cleaner, maps::MapPackageWriter& writer,
                        const ProgressCallback& progress, const CancelFlag& cancel) {
  TileCounts out{{{"cleaned", 0}, {"filled", 0}}, {}};
  const std::vector<maps::TileId> ids = placed.stack.tiles();
  if (ids.empty())
    throw maps::InputError(drives.drives().front().contents().root.string(),
                           "no usable point in any selected scan",
                           "at least one scan with points in range");
  std::map<maps::TileId, std::vector<VoxelSum>> whole;
  if (cleaner != nullptr) {
    const StageTimer timer(out.stage_seconds, "clean");
    const DriveScans scans(drives, survey, placed, grid.origin());
    whole = clean_whole(grid, *cleaner, scans, placed.stack, out.counts, progress, cancel);
  }
  const TileStages stages(drives, survey, objects, grid, options);
  TopView preview = empty_picture(ids);
  std::size_t done = 0;
  process_in_order(
      ids.size(), options.threads,
      [&](std::size_t i) {
        return stages.finish(
            ids[i], cleaner != nullptr ? std::move(whole.at(ids[i])) : placed.stack.take(ids[i]));
      },
      [&](FinishedTile finished) {
        add_to(out.counts, finished.counts);
        add_to(out.stage_seconds, finished.stage_seconds);
        const TilePoints& tile = finished.tile;
        out.counts["static"] += tile.points.size();
        for (const maps::MapPoint& p : tile.points)
          preview.add_point(Eigen::Vector3f(p.x, p.y, p.z).cast<double>());
        if (!tile.points.empty()) writer.add_tile(tile.id, tile.points, tile.history);
        if (progress) progress("tiles", ++done, ids.size());
      },
      cancel);
  preview.write_png(writer.folder() / "preview.png");
  return out;
}

}  // namespace stillmap::mapping
