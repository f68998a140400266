#include "cleaning/free_space_cleaner.hpp"

#include "views/range_view_store.hpp"

#include <stillmap/maps/map_package.hpp>

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <mutex>
#include <optional>
#include <utility>

namespace stillmap::mapping {
namespace {

constexpr auto kTileM = static_cast<float>(maps::kTileSizeM);
/// Scans read at once for each thread; memory holds as many.
constexpr std::size_t kScansPerThread = 2;

using Tile = std::pair<int, int>;
using Tiles = std::map<Tile, std::vector<std::uint32_t>>;

/// Calls `work(i)` for 0 <= i < n from as many threads as the arena has, or from this one.
template <typename Work>
void for_each(tbb::task_arena& arena, std::size_t n, const Work& work) {
  if (arena.max_concurrency() == 1) {
    for (std::size_t i = 0; i < n; ++i) work(i);
    return;
  }
  arena.execute([&] { tbb::parallel_for(std::size_t{0}, n, work); });
}

Tile tile_of(const Eigen::Vector3f& p) {
  return {static_cast<int>(std::floor(p.x() / kTileM)),
          static_cast<int>(std::floor(p.y() / kTileM))};
}

Tiles by_tile(const std::vector<Eigen::Vector3f>& positions) {
  Tiles tiles;
  for (std::uint32_t i = 0; i < positions.size(); ++i) tiles[tile_of(positions[i])].push_back(i);
  return tiles;
}

Eigen::AlignedBox2f area_of(const Tile& tile) {
  const Eigen::Vector2f corner(static_cast<float>(tile.first) * kTileM,
                               static_cast<float>(tile.second) * kTileM);
  return {corner, corner + Eigen::Vector2f::Constant(kTileM)};
}

/// Numbers, increasing, of the points in a tile and its rim.
std::vector<std::uint32_t> with_rim(const Tiles& tiles, const Tile& tile,
                                    const std::vector<Eigen::Vector3f>& positions, float rim_m) {
  Eigen::AlignedBox2f wanted = area_of(tile);
  wanted.min().array() -= rim_m;
  wanted.max().array() += rim_m;
  const int reach = static_cast<int>(std::ceil(rim_m / kTileM));
  std::vector<std::uint32_t> numbers;
  for (int x = tile.first - reach; x <= tile.first + reach; ++x) {
    for (int y = tile.second - reach; y <= tile.second + reach; ++y) {
      const auto at = tiles.find({x, y});
      if (at == tiles.end()) continue;
      std::copy_if(at->second.begin(), at->second.end(), std::back_inserter(numbers),
                   [&](std::uint32_t i) {
                     return wanted.contains(Eigen::Vector2f(positions[i].head<2>()));
                   });
    }
  }
  std::sort(numbers.begin(), numbers.end());
  return numbers;
}

CleaningPoints part_of(const CleaningPoints& points, const std::vector<std::uint32_t>& numbers) {
  CleaningPoints part;
  part.voxel_size_m = points.voxel_size_m;
  for (const std::uint32_t i : numbers) {
    part.positions.push_back(points.positions[i]);
    part.is_ground.push_back(points.is_ground[i]);
    part.scans.push_back(points.scans[i]);
  }
  return part;
}

/// Tells progress from several threads, and ends work when it is cancelled.
class Steps {
 public:
  Steps(const char* stage, std::size_t total, const ProgressCallback& progress,
        const CancelFlag& cancel)
      : stage_(stage), total_(total), progress_(progress), cancel_(cancel) {}
  void begin() const {
    if (cancel_) throw Cancelled();
  }
  void end() {
    const std::scoped_lock lock(mutex_);
    ++done_;
    if (progress_) progress_(stage_, done_, total_);
  }

 private:
  const char* stage_;
  std::size_t done_ = 0, total_;
  const ProgressCallback& progress_;
  const CancelFlag& cancel_;
  std::mutex mutex_;
};

/// Puts the views of the keyframes into the store, in their order.
void store_views(RangeViewStore& store, const std::vector<Keyframe>& keyframes,
                 const ScanSource& scans, tbb::task_arena& arena, Steps& steps) {
  const std::size_t batch = kScansPerThread * static_cast<std::size_t>(arena.max_concurrency());
  for (std::size_t begin = 0; begin < keyframes.size(); begin += batch) {
    std::vector<std::optional<RangeView>> views(std::min(batch, keyframes.size() - begin));
    for_each(arena, views.size(), [&](std::size_t i) {
      steps.begin();
      const PosedScan scan = scans.read(keyframes[begin + i].scan);
      views[i].emplace(scan.positions, scan.is_ground);
    });
    for (const auto& view : views) {
      store.append(*view);
      steps.end();
    }
  }
}

}  // namespace

std::vector<std::uint8_t> FreeSpaceCleaner::moved(const CleaningPoints& points,
                                                  const ScanSource& scans,
                                                  const ProgressCallback& progress,
                                                  const CancelFlag& cancel) const {
  tbb::task_arena arena(threads_ == 0 ? tbb::task_arena::automatic : threads_);
  PosedViews views;
  for (std::size_t i = 0; i < scans.size(); ++i)
    views.T_local_lidar.push_back(scans.T_local_lidar(i));
  const std::vector<Keyframe> keyframes = select_keyframes(views.T_local_lidar);
  std::vector<std::size_t> ordinal_of_scan(scans.size());
  for (std::size_t k = 0; k < keyframes.size(); ++k) ordinal_of_scan[keyframes[k].scan] = k;
  RangeViewStore store(scratch_);
  {
    Steps steps("views", keyframes.size(), progress, cancel);
    store_views(store, keyframes, scans, arena, steps);
  }
  views.read = [&](std::size_t scan) { return store.read(ordinal_of_scan[scan]); };

  const Tiles tiles = by_tile(points.positions);
  std::vector<const Tiles::value_type*> list;
  for (const auto& tile : tiles) list.push_back(&tile);
  const auto rim_m = static_cast<float>(free_space_rim_m(points.voxel_size_m));
  std::vector<std::uint8_t> flags(points.positions.size());
  Steps steps("clean", list.size(), progress, cancel);
  for_each(arena, list.size(), [&](std::size_t k) {
    steps.begin();
    const Tile tile = list[k]->first;
    const auto numbers = with_rim(tiles, tile, points.positions, rim_m);
    const auto moved =
        moved_by_free_space(part_of(points, numbers), area_of(tile), views, keyframes);
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      if (tile_of(points.positions[numbers[i]]) == tile) flags[numbers[i]] = moved[i];
    }
    steps.end();
  });
  return flags;
}

}  // namespace stillmap::mapping
