#include "index/voxel_build.hpp"

#include "measured_points.hpp"
#include "voxel_moments.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

namespace stillmap::localization {
namespace {

/// What a place was seen from near by, and often, outweighs what far scans put beside it: where the
/// map's poses slide, near scans agree with the query's own. The root, because repeated
/// observations of a place share their error.
double weight_of(const maps::MapPoint& point) {
  return std::sqrt(static_cast<double>(std::max<std::uint16_t>(1, point.observations)));
}

VoxelLevel level_of(const MomentGrid& grid, double edge_m, int min_points) {
  std::vector<std::pair<CellBlocks::Place, const Moments*>> kept;
  for (const Moments& cell : grid.cells) {
    if (cell.count < static_cast<std::uint32_t>(min_points)) continue;
    const auto [x, y, z] = cell_of_key(cell.key);
    kept.emplace_back(CellBlocks::place_of(x, y, z), &cell);
  }
  // Neighbours in space become neighbours in memory.
  std::sort(kept.begin(), kept.end(),
            [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<CellBlocks::Place> places;
  std::vector<Voxel> voxels;
  places.reserve(kept.size());
  voxels.reserve(kept.size());
  for (const auto& [place, cell] : kept) {
    places.push_back(place);
    voxels.push_back(voxel_of(*cell, edge_m));
  }
  return {CellBlockTable(places), std::move(voxels)};
}

/// Level whose cells are nearest to those that grids are made of.
std::size_t level_for_places(const MapIndexOptions& options) {
  // The coarsest is level 0.
  const double doublings = std::log2(kPlaceCellM / options.finest_voxel_m);
  const int up = std::clamp(static_cast<int>(std::lround(doublings)), 0, options.levels - 1);
  return static_cast<std::size_t>(options.levels - 1 - up);
}

template <typename ForEachPoint>
IndexContent build_from(const ForEachPoint& for_each_point, const std::string& source,
                        const MapIndexOptions& options) {
  Eigen::Vector3d min = Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity());
  Eigen::Vector3d max = -min;
  for_each_point([&](const Eigen::Vector3d& p_map, double /*weight*/) {
    if (!p_map.allFinite()) throw std::invalid_argument(source + ": a point is not finite");
    min = min.cwiseMin(p_map);
    max = max.cwiseMax(p_map);
  });
  const std::string wanted = fmt::format("a voxel of {} m with {} measured points or more",
                                         options.finest_voxel_m, options.min_points);
  if (!min.allFinite()) throw maps::InputError(source, "no measured point", wanted);
  const double limit_m = options.finest_voxel_m * (kCellsPerAxis - 1);
  if (!((max - min).maxCoeff() < limit_m)) {
    throw maps::InputError(source, fmt::format("an extent of {} m", (max - min).maxCoeff()),
                           fmt::format("less than {} m", limit_m));
  }
  if (TiledColumns(max - min, kPlaceGrids.back().edge_m).tiles() > kMostGridTiles) {
    throw maps::InputError(source,
                           fmt::format("an extent of {} by {} m", (max - min).x(), (max - min).y()),
                           "one below 17,000 km^2: build maps of parts of the drives");
  }
  MomentGrid grid;
  for_each_point([&](const Eigen::Vector3d& p_map, double weight) {
    const Eigen::Vector3d p = p_map - min;
    const Eigen::Vector3i cell = (p / options.finest_voxel_m).array().floor().cast<int>();
    grid.at(cell_key(cell.x(), cell.y(), cell.z())).add(p, weight);
  });
  IndexContent content{.origin = min, .extent = max - min, .levels = {}, .place_grids = {}};
  double edge_m = options.finest_voxel_m;
  for (int level = 0; level < options.levels; ++level, edge_m *= 2.0) {
    if (level > 0) grid = coarser(grid);
    content.levels.push_back(level_of(grid, edge_m, options.min_points));
  }
  std::reverse(content.levels.begin(), content.levels.end());
  if (content.levels.back().voxels.empty()) {
    throw maps::InputError(source, "none", wanted);
  }
  const VoxelLevel& level = content.levels[level_for_places(options)];
  for (const PlaceGrid& place_grid : kPlaceGrids) {
    content.place_grids.emplace_back(level.voxels, content.extent, place_grid.edge_m,
                                     place_grid.spread);
  }
  return content;
}

}  // namespace

IndexContent build_voxels(const maps::MapPackage& map, const MapIndexOptions& options) {
  const auto for_each_point = [&](const auto& visit) {
    for_each_measured_point(map, [&](const Eigen::Vector3d& p_map, const maps::MapPoint& point) {
      visit(p_map, weight_of(point));
    });
  };
  return build_from(for_each_point, map.folder().string(), options);
}

IndexContent build_voxels(const std::vector<Eigen::Vector3d>& points_map,
                          const MapIndexOptions& options) {
  const auto for_each_point = [&](const auto& visit) {
    for (const Eigen::Vector3d& p_map : points_map) visit(p_map, 1.0);
  };
  return build_from(for_each_point, "map points", options);
}

}  // namespace stillmap::localization
