#include "cleaning/seen_cubes.hpp"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <memory>

namespace stillmap::mapping {
namespace {

constexpr double kCubeViewEveryM = 8.0;
/// A vehicle that stands sees what passes.
constexpr std::size_t kCubeViewEveryScans = 100;
constexpr double kCubeReachM = 25.0;
/// Nearer than this a view meets its own vehicle [m].
constexpr double kCubeNearestM = 2.0;
/// Of the ball in the middle of a cube that must be free.
constexpr float kCubeBallM = 0.25F;

maps::TileId tile_under(const Eigen::Vector3d& p_local) {
  const auto number = [](double value) {
    return static_cast<std::int32_t>(std::floor(value / maps::kTileSizeM));
  };
  return {.level = 0, .x = number(p_local.x()), .y = number(p_local.y())};
}

/// Adds what a view says of each cube.
void look_at_cubes(const RangeView& view, const Eigen::Isometry3d& T_local_lidar, float doubt_m,
                   const Eigen::Vector3d& corner, const maps::TileEvidence& cubes,
                   maps::TileEvidence::OfDrive& seen) {
  const Eigen::Isometry3d T_lidar_local = T_local_lidar.inverse();
  for (std::size_t cube = 0; cube < maps::TileEvidence::kCubes; ++cube) {
    if (seen.hit[cube] && seen.free[cube]) continue;
    const Eigen::Vector3d p_lidar = T_lidar_local * (corner + cubes.middle_of(cube));
    const double distance_m = p_lidar.norm();
    if (distance_m < kCubeNearestM || distance_m > kCubeReachM) continue;
    const Sight sight = view.look(p_lidar.cast<float>(), kCubeBallM, doubt_m).sight;
    if (sight == Sight::kHit) seen.hit.set(cube);
    if (sight == Sight::kFree) seen.free.set(cube);
  }
}

}  // namespace

SeenCubes::SeenCubes(const PosedViews& views, std::span<const std::size_t> drive_of_scan)
    : views_(views) {
  std::size_t last = 0;
  for (std::size_t scan = 0; scan < drive_of_scan.size(); ++scan) {
    const Eigen::Vector3d p = views.T_local_lidar[scan].translation();
    const bool begins = scan == 0 || drive_of_scan[scan] != drive_of_scan[scan - 1];
    const Eigen::Vector3d way = p - views.T_local_lidar[last].translation();
    if (!begins && way.norm() < kCubeViewEveryM && scan - last < kCubeViewEveryScans) continue;
    last = scan;
    // It would put what it saw into other cubes.
    if (!views.doubts.empty() && views.doubts[scan].at(kCubeReachM) > kCubeBallM) continue;
    by_tile_[tile_under(p)].push_back({drive_of_scan[scan], scan});
  }
}

maps::TileEvidence SeenCubes::of(maps::TileId tile, std::int32_t lowest_m) const {
  constexpr int kTilesAround = 2;
  static_assert(kCubeReachM < kTilesAround * maps::kTileSizeM);
  std::vector<View> views;
  for (std::int32_t x = tile.x - kTilesAround; x <= tile.x + kTilesAround; ++x) {
    for (std::int32_t y = tile.y - kTilesAround; y <= tile.y + kTilesAround; ++y) {
      const auto found = by_tile_.find({.level = 0, .x = x, .y = y});
      if (found != by_tile_.end())
        views.insert(views.end(), found->second.begin(), found->second.end());
    }
  }
  std::sort(views.begin(), views.end(),
            [](const View& a, const View& b) { return a.scan < b.scan; });
  maps::TileEvidence evidence{.base_m = lowest_m, .drives = {}};
  for (const View& each : views) {
    if (evidence.drives.empty() || evidence.drives.back().drive != each.drive)
      evidence.drives.push_back({static_cast<std::uint32_t>(each.drive), {}, {}});
    const float doubt_m = views_.doubts.empty() ? 0.0F : views_.doubts[each.scan].at(kCubeReachM);
    look_at_cubes(*views_.read(each.scan), views_.T_local_lidar[each.scan], doubt_m,
                  maps::corner_of(tile), evidence, evidence.drives.back());
  }
  std::erase_if(evidence.drives,
                [](const auto& seen) { return seen.free.none() && seen.hit.none(); });
  return evidence;
}

}  // namespace stillmap::mapping
