#include "index/voxel_build.hpp"

#include "index_grid.hpp"
#include "measured_points.hpp"

#include <stillmap/maps/crc32c.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/sha256.hpp>
#include <stillmap/maps/tile_check.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <span>
#include <stdexcept>
#include <tuple>
#include <utility>

namespace stillmap::localization {
namespace {

/// What a place was seen from near by, and often, outweighs what far scans put beside it: where the
/// map's poses slide, near scans agree with the query's own. The root, because repeated
/// observations of a place share their error.
double weight_of(const maps::MapPoint& point) {
  return std::sqrt(static_cast<double>(std::max<std::uint16_t>(1, point.observations)));
}

/// Level whose cells are nearest to those that grids are made of.
std::size_t level_for_places(const MapIndexOptions& options) {
  // The coarsest is level 0.
  const double doublings = std::log2(kPlaceCellM / options.finest_voxel_m);
  const int up = std::clamp(static_cast<int>(std::lround(doublings)), 0, options.levels - 1);
  return static_cast<std::size_t>(options.levels - 1 - up);
}

/// Points are rounded when they are stored, bounds are not [m].
constexpr double kRoundedM = 0.01;

std::int32_t floor_below(double lowest_m) {
  if (std::abs(lowest_m) < kFarthestRegionM)
    return static_cast<std::int32_t>(std::floor(lowest_m / kRegionM));
  throw maps::InputError("map points", fmt::format("a height of {} m", lowest_m),
                         fmt::format("less than {} m", kFarthestRegionM));
}

}  // namespace

RegionBuilder::RegionBuilder(const MapIndexOptions& options, double lowest_m,
                             const std::filesystem::path& scratch)
    : options_(options), floor_(floor_below(lowest_m)), voxels_(scratch) {}

void RegionBuilder::begin_block(int x, int y) {
  end_block();
  first_ = cells_of_block() * Eigen::Array2i(x, y);
}

int RegionBuilder::cells_of_block() const {
  return static_cast<int>(std::lround(kBlockM / options_.finest_voxel_m));
}

void RegionBuilder::add(const Eigen::Vector3d& p, double weight) {
  const double edge_m = options_.finest_voxel_m;
  const Eigen::Array3d cell = (p.array() / edge_m).floor();
  const auto along = [&](Eigen::Index axis) {
    const double first = first_[axis];
    const double last = first + cells_of_block() - 1;
    if (!(cell[axis] >= first - 1.0 && cell[axis] <= last + 1.0)) {
      throw maps::InputError("map points", fmt::format("a point at {} m of a region", p[axis]),
                             "points inside of their tiles: check the package (stillmap verify)");
    }
    // A point on the border may be rounded across it.
    return static_cast<std::int32_t>(std::clamp(cell[axis], first, last));
  };
  const double z = cell.z() + kCellsPerAxis / 2;
  if (!(z >= 0.0 && z < kCellsPerAxis && p.z() >= kRegionM * floor_)) {
    throw maps::InputError("map points", fmt::format("a height of {} m", p.z()),
                           fmt::format("less than {} m, and no less than the bounds of its tile",
                                       0.5 * edge_m * kCellsPerAxis));
  }
  grid_.at(cell_key(along(0), along(1), static_cast<std::int32_t>(z))).add(p, weight);
}

void RegionBuilder::end_block() {
  MomentGrid grid = std::exchange(grid_, MomentGrid());
  for (int halvings = 0; halvings < options_.levels; ++halvings) {
    if (halvings > 0) grid = coarser(grid);
    const double edge_m = std::ldexp(options_.finest_voxel_m, halvings);
    const std::int32_t below = (kCellsPerAxis / 2 >> halvings) + floor_ * cells_of_region(edge_m);
    std::vector<std::pair<CellBlocks::Place, const Moments*>> cells;
    for (const Moments& cell : grid.cells) {
      if (cell.count < static_cast<std::uint32_t>(options_.min_points)) continue;
      const auto [x, y, z] = cell_of_key(cell.key);
      cells.emplace_back(CellBlocks::place_of(x, y, z - below), &cell);
    }
    // Neighbours in space become neighbours in memory.
    std::sort(cells.begin(), cells.end());
    voxels_.begin_run(static_cast<std::size_t>(options_.levels - 1 - halvings));
    for (const auto& [place, cell] : cells)
      voxels_.add(place, voxel_of(*cell, edge_m, {0.0, 0.0, kRegionM * floor_}));
  }
}

RegionContent RegionBuilder::content() && {
  end_block();
  RegionContent content{
      .floor = floor_, .levels = {}, .place_grids = {}, .voxels = std::move(voxels_)};
  for (const float edge_m : kPlaceGridEdgesM) content.place_grids.emplace_back(edge_m);
  for (std::size_t k = 0; std::cmp_less(k, options_.levels); ++k) {
    VoxelLevel level{.cells = CellBlockTable(tile_shift_of(edge_of_level(options_, k)))};
    content.voxels.for_each(k, [&](const CellBlocks::Place& place, const Voxel& voxel) {
      level.cells.add(place);
      level.voxels_crc = maps::crc32c(std::as_bytes(std::span(&voxel, 1)), level.voxels_crc);
      if (k != level_for_places(options_)) return;
      for (CellBitsTable& grid : content.place_grids) grid.add(voxel);
    });
    level.cells.finish();
    content.levels.push_back(std::move(level));
  }
  return content;
}

MapRegions::MapRegions(const maps::MapPackage& map, const MapIndexOptions& options)
    : map_(map), options_(options) {
  for (const maps::TileEntry& entry : map.tiles()) {
    if (entry.id.level != 0) continue;
    RegionTiles& region = tiles_[maps::region_of(entry.id)];
    region.tiles.push_back(entry.id);
    region.lowest_m = std::min(region.lowest_m, entry.min[2]);
  }
  for (auto& [id, region] : tiles_) std::sort(region.tiles.begin(), region.tiles.end());
}

std::vector<maps::RegionId> MapRegions::regions() const {
  std::vector<maps::RegionId> regions;
  for (const auto& [id, region] : tiles_) regions.push_back(id);
  return regions;
}

std::string MapRegions::source_of(maps::RegionId region) const {
  maps::Sha256 hash;
  const auto found = tiles_.find(region);
  if (found == tiles_.end()) return hash.hex();
  for (const maps::TileId tile : found->second.tiles) {
    const std::string row =
        fmt::format("{} {} {}\n", tile.x - maps::kRegionTiles * region.x,
                    tile.y - maps::kRegionTiles * region.y, map_.stored_name(tile).sha256);
    hash.add(row.data(), row.size());
  }
  return hash.hex();
}

RegionContent MapRegions::build(maps::RegionId region, const std::filesystem::path& scratch) const {
  constexpr auto kBlockTiles = static_cast<int>(RegionBuilder::kBlockM / maps::kTileSizeM);
  const Eigen::Vector2d corner = corner_of(region);
  const double below_m = below_origin_m(options_);
  const RegionTiles& own = tiles_.at(region);
  std::map<std::pair<int, int>, std::vector<maps::TileId>> blocks;
  for (const maps::TileId id : own.tiles) {
    blocks[{(id.x - maps::kRegionTiles * region.x) / kBlockTiles,
            (id.y - maps::kRegionTiles * region.y) / kBlockTiles}]
        .push_back(id);
  }
  RegionBuilder builder(options_, own.lowest_m + below_m - kRoundedM, scratch);
  for (const auto& [block, tiles] : blocks) {
    builder.begin_block(block.first, block.second);
    for (const maps::TileId id : tiles) {
      // The files outlive this process, and nobody compares them with the points again.
      maps::require_whole_tile(map_, id);
      for_each_measured_point(map_, id, [&](const Eigen::Vector3d& p, const maps::MapPoint& point) {
        builder.add({p.x() - corner.x(), p.y() - corner.y(), p.z() + below_m}, weight_of(point));
      });
    }
    map_.release_pages();
  }
  return std::move(builder).content();
}

std::map<maps::RegionId, RegionContent> build_regions(const std::vector<Eigen::Vector3d>& points,
                                                      const MapIndexOptions& options) {
  using Block = std::tuple<maps::RegionId, int, int>;
  std::map<Block, std::vector<Eigen::Vector3d>> blocks;
  std::map<maps::RegionId, double> lowest_m;
  for (const Eigen::Vector3d& p : points) {
    if (!p.allFinite()) throw std::invalid_argument("map points: a point is not finite");
    if (!(p.cwiseAbs().maxCoeff() < kFarthestRegionM)) {
      throw maps::InputError("map points",
                             fmt::format("a point {} m from the origin", p.cwiseAbs().maxCoeff()),
                             fmt::format("less than {} m", kFarthestRegionM));
    }
    const maps::RegionId region = region_at(p.x(), p.y());
    const Eigen::Vector2d from_corner = p.head<2>() - corner_of(region);
    const auto block = [](double along_m) {
      constexpr int kLast = static_cast<int>(kRegionM / RegionBuilder::kBlockM) - 1;
      return std::clamp(static_cast<int>(along_m / RegionBuilder::kBlockM), 0, kLast);
    };
    blocks[{region, block(from_corner.x()), block(from_corner.y())}].emplace_back(
        from_corner.x(), from_corner.y(), p.z());
    const auto lowest = lowest_m.try_emplace(region, p.z()).first;
    lowest->second = std::min(lowest->second, p.z());
  }
  std::map<maps::RegionId, RegionContent> regions;
  for (auto block = blocks.begin(); block != blocks.end();) {
    const maps::RegionId region = std::get<0>(block->first);
    RegionBuilder builder(options, lowest_m.at(region), {});
    for (; block != blocks.end() && std::get<0>(block->first) == region; ++block) {
      builder.begin_block(std::get<1>(block->first), std::get<2>(block->first));
      for (const Eigen::Vector3d& p : block->second) builder.add(p, 1.0);
    }
    regions.emplace(region, std::move(builder).content());
  }
  return regions;
}

}  // namespace stillmap::localization
