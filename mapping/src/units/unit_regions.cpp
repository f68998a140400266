#include "units/unit_regions.hpp"

#include <algorithm>
#include <cmath>
#include <map>

namespace stillmap::mapping {
namespace {

/// Mounts of several lidars on a vehicle, and sweeps that overlap the next scan.
constexpr double kSlackM = 10.0;

std::int32_t region_along(double along_m) {
  return static_cast<std::int32_t>(std::floor(along_m / maps::kRegionSizeM));
}

}  // namespace

bool UnitRegions::needs(maps::TileId tile) const {
  for (std::int32_t step = 0; step < 9; ++step) {
    if (regions.contains(
            maps::region_of({tile.level, tile.x + step % 3 - 1, tile.y + step / 3 - 1})))
      return true;
  }
  return false;
}

double reach_m(const Build& build, std::size_t scan) {
  const auto [drive, index] = build.drives->place(scan);
  const std::vector<Eigen::Isometry3d>& poses =
      build.drives->drives()[drive].contents().T_map_lidar;
  double moved_m = 0.0;
  for (const std::size_t other :
       {index == 0 ? 0 : index - 1, std::min(index + 1, poses.size() - 1)})
    moved_m = std::max(moved_m, (poses[other].translation() - poses[index].translation()).norm());
  return build.task.options.max_range_m + moved_m + kSlackM;
}

std::vector<UnitRegions> regions_of_units(const Build& build, std::size_t units) {
  const DriveSet& drives = *build.drives;
  std::map<maps::RegionId, std::vector<std::size_t>> seen_by;
  std::vector<Eigen::Vector2d> places;
  std::vector<double> reaches_m;
  for (std::size_t scan = 0; scan < drives.size(); ++scan) {
    const Eigen::Vector2d p =
        (drives.T_map_scan(scan).translation() - build.grid->origin()).head<2>();
    places.push_back(p);
    reaches_m.push_back(reach_m(build, scan));
    // A tile more: scans that see the rim of a region see what its own tiles are cleaned by.
    const double seen_from_m = reaches_m.back() + maps::kTileSizeM;
    for (auto x = region_along(p.x() - seen_from_m); x <= region_along(p.x() + seen_from_m); ++x) {
      for (auto y = region_along(p.y() - seen_from_m); y <= region_along(p.y() + seen_from_m); ++y)
        seen_by[{x, y}].push_back(scan);
    }
  }
  std::size_t all = 0;
  for (const auto& [region, scans] : seen_by) all += scans.size();
  std::vector<UnitRegions> shares(units);
  std::vector<std::set<std::size_t>> scans_of(units);
  std::size_t before = 0;
  for (const auto& [region, scans] : seen_by) {
    // By where the middle of its scans lies among those of all regions.
    const std::size_t share = (2 * before + scans.size()) * units / (2 * all);
    before += scans.size();
    shares[share].regions.insert(region);
    scans_of[share].insert(scans.begin(), scans.end());
  }
  for (std::size_t i = 0; i < units; ++i) {
    UnitRegions& share = shares[i];
    share.scans.assign(scans_of[i].begin(), scans_of[i].end());
    for (const std::size_t scan : share.scans) {
      const Eigen::Vector2d& p = places[scan];
      if (share.regions.contains({region_along(p.x()), region_along(p.y())}))
        share.own_scans.insert(scan);
      share.ground.extend(
          Eigen::AlignedBox2d(p.array() - reaches_m[scan], p.array() + reaches_m[scan]));
    }
  }
  return shares;
}

}  // namespace stillmap::mapping
