#include <fmt/format.h>
#include <stillmap/maps/error.hpp>

#include <Eigen/Geometry>

#include <string>
#include <vector>

#include "exports/exporters.hpp"
#include "exports/occupancy_grid.hpp"
#include "exports/output_file.hpp"

namespace stillmap::maps {
namespace {

constexpr double kResolutionM = 0.1;
/// Above kerbs, below what a vehicle passes under.
constexpr std::array<double, 2> kHeightBandM{0.2, 2.0};
constexpr double kMostGridCells = 4e8;
constexpr double kMostSquareMetres = 1e8;
/// Nav2's own greys (map_saver): free, occupied, and an unknown that `free_thresh` keeps unknown.
constexpr char kFree = static_cast<char>(254);
constexpr char kOccupied = 0;
constexpr char kUnknown = static_cast<char>(205);

Eigen::AlignedBox2d bounds_of(const MapPackage& map) {
  Eigen::AlignedBox2d bounds;
  for (const TileEntry& tile : point_tiles(map)) {
    bounds.extend(tile.from_origin().min().head<2>());
    bounds.extend(tile.from_origin().max().head<2>());
  }
  return bounds;
}

GroundHeights ground_of(const ExportJob& job, const Eigen::AlignedBox2d& bounds) {
  GroundHeights ground(bounds.min(), bounds.max());
  const std::vector<TileEntry> tiles = point_tiles(job.map);
  for (std::size_t i = 0; i < tiles.size(); ++i) {
    // Heights take all the ground there is, also where it is not to be shown.
    const MapTile tile = job.map.tile(tiles[i].id);
    for (const MapPoint& point : tile)
      if (point.kind != PointKind::kMeasured) ground.add(tile.from_origin(point));
    job.tell({0.2, 0.3}, i + 1, tiles.size());
  }
  if (!ground.finish())
    throw InputError(job.map.folder().string(), "no ground",
                     "a map whose ground was found: `stillmap build` makes one");
  return ground;
}

/// Where the scans were taken, by their ordinals, from the map's origin.
std::vector<Eigen::Vector3d> sensors_of(const MapPackage& map) {
  std::vector<Eigen::Vector3d> sensors;
  for (const Trajectory& trajectory : map.trajectories())
    for (const StampedPose& pose : trajectory.poses())
      sensors.push_back(pose.T_map_lidar.translation() - map.manifest().origin);
  return sensors;
}

void add_points(const ExportJob& job, TileId id, OccupancyGrid& grid) {
  const MapTile tile = job.map.tile(id);
  for (const MapPoint& point : tile)
    if (job.takes(point.kind))
      grid.add_point(tile.from_origin(point), point.kind != PointKind::kMeasured);
}

void add_rays(const ExportJob& job, TileId id, const std::vector<Eigen::Vector3d>& sensors,
              OccupancyGrid& grid) {
  const MapTile tile = job.map.tile(id);
  const std::vector<PointHistory> history = job.map.history(id);
  for (std::size_t i = 0; i < history.size(); ++i) {
    if (!is_measured(tile[i].kind)) continue;
    const Eigen::Vector3d p = tile.from_origin(tile[i]);
    const auto [first, last] = std::pair(history[i].first_scan, history[i].last_scan);
    if (first < sensors.size()) grid.add_ray(sensors[first], p);
    if (last != first && last < sensors.size()) grid.add_ray(sensors[last], p);
  }
}

void write_picture(ExportJob& job, const OccupancyGrid& grid) {
  OutputFile file(job.target / "map.pgm");
  file.write(fmt::format("P5\n{} {}\n255\n", grid.width(), grid.height()));
  std::string row(grid.width(), kUnknown);
  std::array<std::uint64_t, 3> counts{};
  // The picture begins with the row of the largest y.
  for (std::size_t y = grid.height(); y-- > 0;) {
    for (std::size_t x = 0; x < grid.width(); ++x) {
      const Cell cell = grid.at(x, y);
      row[x] = cell == Cell::kFree ? kFree : cell == Cell::kOccupied ? kOccupied : kUnknown;
      ++counts.at(static_cast<std::size_t>(cell));
    }
    file.write(row);
  }
  file.close();
  job.result.counts["cells_unknown"] = counts[0];
  job.result.counts["cells_free"] = counts[1];
  job.result.counts["cells_occupied"] = counts[2];
}

void write_yaml(const ExportJob& job, const OccupancyGrid& grid, double resolution_m) {
  const Eigen::Vector2d corner =
      grid.min() + (job.map.manifest().origin - job.result.origin).head<2>();
  OutputFile file(job.target / "map.yaml");
  file.write(fmt::format(
      "image: map.pgm\nmode: trinary\nresolution: {}\norigin: [{:.6f}, {:.6f}, 0.0]\nnegate: 0\n"
      "occupied_thresh: 0.65\nfree_thresh: 0.196\n",
      resolution_m, corner.x(), corner.y()));
  file.close();
}

}  // namespace

void export_nav2(ExportJob& job) {
  count_chosen(job);
  const double resolution_m = job.options.resolution_m.value_or(kResolutionM);
  const Eigen::AlignedBox2d bounds = bounds_of(job.map);
  const double cells = OccupancyGrid::cells(bounds.min(), bounds.max(), resolution_m);
  if (!(cells <= kMostGridCells))
    throw InputError(job.map.folder().string(),
                     fmt::format("{:.3g} cells of {} m", cells, resolution_m),
                     fmt::format("at most {:.3g}: give a coarser --resolution", kMostGridCells));
  if (const double area_m2 = bounds.volume(); !(area_m2 <= kMostSquareMetres))
    throw InputError(
        job.map.folder().string(), fmt::format("{:.3g} square metres", area_m2),
        fmt::format("at most {:.3g}: build and export a map of a part of the drive (--select)",
                    kMostSquareMetres));
  const GroundHeights ground = ground_of(job, bounds);
  OccupancyGrid grid(bounds.min(), bounds.max(), resolution_m,
                     job.options.height_band_m.value_or(kHeightBandM), ground);
  const std::vector<Eigen::Vector3d> sensors = sensors_of(job.map);
  if (sensors.empty())
    job.result.notes.emplace_back("no trajectory: only ground is free, nothing is seen through");
  const std::vector<TileEntry> tiles = point_tiles(job.map);
  // What is known already need not be traced.
  for (const TileEntry& tile : tiles) add_points(job, tile.id, grid);
  for (std::size_t i = 0; i < tiles.size(); ++i) {
    add_rays(job, tiles[i].id, sensors, grid);
    job.tell({0.3, 1.0}, i + 1, tiles.size());
  }
  write_picture(job, grid);
  write_yaml(job, grid, resolution_m);
}

}  // namespace stillmap::maps
