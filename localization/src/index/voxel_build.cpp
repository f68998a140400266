#include "index/voxel_build.hpp"

#include "index_grid.hpp"
#include "measured_points.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/sha256.hpp>
#include <stillmap/maps/tile_check.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
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

/// Level whose cells are nearest to those that grids are made of.
std::size_t level_for_places(const MapIndexOptions& options) {
  // The coarsest is level 0.
  const double doublings = std::log2(kPlaceCellM / options.finest_voxel_m);
  const int up = std::clamp(static_cast<int>(std::lround(doublings)), 0, options.levels - 1);
  return static_cast<std::size_t>(options.levels - 1 - up);
}

/// Cells of one level with enough points.
class LevelCells {
 public:
  /// @param halvings  of the cells' number since the finest level.
  LevelCells(const MomentGrid& grid, const MapIndexOptions& options, double rim_m, int halvings)
      : edge_m_(std::ldexp(options.finest_voxel_m, halvings)),
        first_(static_cast<int>(std::lround(rim_m / edge_m_)),
               static_cast<int>(std::lround(rim_m / edge_m_)), kCellsPerAxis / 2 >> halvings),
        side_(cells_of_region(edge_m_)) {
    for (const Moments& cell : grid.cells)
      if (cell.count >= static_cast<std::uint32_t>(options.min_points)) kept_.push_back(&cell);
  }

  /// In units of `kRegionM`: below all cells of the region.
  [[nodiscard]] std::int32_t floor() const {
    std::int32_t lowest = kCellsPerAxis;
    for (const Moments* cell : kept_)
      if (is_own(*cell)) lowest = std::min(lowest, cell_of(*cell).z());
    if (lowest == kCellsPerAxis) return 0;
    return static_cast<std::int32_t>(std::floor(static_cast<double>(lowest) / side_));
  }

  [[nodiscard]] VoxelLevel level(std::int32_t floor) const {
    std::vector<std::pair<CellBlocks::Place, const Moments*>> own;
    for (const Moments* cell : kept_) {
      if (!is_own(*cell)) continue;
      const Eigen::Array3i at = cell_of(*cell) - Eigen::Array3i(0, 0, floor * side_);
      own.emplace_back(CellBlocks::place_of(at.x(), at.y(), at.z()), cell);
    }
    // Neighbours in space become neighbours in memory.
    std::sort(own.begin(), own.end(),
              [](const auto& a, const auto& b) { return a.first < b.first; });
    std::vector<CellBlocks::Place> places;
    std::vector<Voxel> voxels;
    places.reserve(own.size());
    voxels.reserve(own.size());
    for (const auto& [place, cell] : own) {
      places.push_back(place);
      voxels.push_back(voxel_at(*cell, floor));
    }
    return {CellBlockTable(places, tile_shift_of(edge_m_)), std::move(voxels)};
  }

  /// Of the region and its rim.
  [[nodiscard]] std::vector<Voxel> all_voxels(std::int32_t floor) const {
    std::vector<Voxel> voxels;
    voxels.reserve(kept_.size());
    for (const Moments* cell : kept_) voxels.push_back(voxel_at(*cell, floor));
    return voxels;
  }

 private:
  [[nodiscard]] Eigen::Array3i cell_of(const Moments& cell) const {
    const auto [x, y, z] = cell_of_key(cell.key);
    return Eigen::Array3i(x, y, z) - first_;
  }
  [[nodiscard]] bool is_own(const Moments& cell) const {
    const Eigen::Array3i at = cell_of(cell);
    return at.x() >= 0 && at.x() < side_ && at.y() >= 0 && at.y() < side_;
  }
  [[nodiscard]] Voxel voxel_at(const Moments& cell, std::int32_t floor) const {
    return voxel_of(cell, edge_m_, {0.0, 0.0, kRegionM * floor});
  }

  double edge_m_;
  Eigen::Array3i first_;
  std::int32_t side_;
  std::vector<const Moments*> kept_;
};

}  // namespace

double RegionBuilder::rim_m(const MapIndexOptions& options) {
  const double coarsest_m = edge_of_level(options, 0);
  return coarsest_m * std::ceil(kPlaceRimM / coarsest_m);
}

RegionBuilder::RegionBuilder(const MapIndexOptions& options)
    : options_(options), rim_m_(rim_m(options)) {}

void RegionBuilder::add(const Eigen::Vector3d& p, double weight) {
  const double edge_m = options_.finest_voxel_m;
  const double x = std::floor((p.x() + rim_m_) / edge_m);
  const double y = std::floor((p.y() + rim_m_) / edge_m);
  const double z = std::floor(p.z() / edge_m) + kCellsPerAxis / 2;
  const double side = std::round((kRegionM + 2.0 * rim_m_) / edge_m);
  if (!(x >= 0.0 && x < side && y >= 0.0 && y < side)) return;
  if (!(z >= 0.0 && z < kCellsPerAxis)) {
    throw maps::InputError("map points", fmt::format("a height of {} m", p.z()),
                           fmt::format("less than {} m", 0.5 * edge_m * kCellsPerAxis));
  }
  grid_
      .at(cell_key(static_cast<std::int32_t>(x), static_cast<std::int32_t>(y),
                   static_cast<std::int32_t>(z)))
      .add(p, weight);
}

RegionContent RegionBuilder::content() const {
  std::vector<MomentGrid> coarse;
  const auto grid = [&](int halvings) -> const MomentGrid& {
    return halvings == 0 ? grid_ : coarse[static_cast<std::size_t>(halvings) - 1];
  };
  for (int halvings = 1; halvings < options_.levels; ++halvings)
    coarse.push_back(coarser(grid(halvings - 1)));
  RegionContent content;
  // The coarsest level has a voxel wherever a finer one has.
  content.floor =
      LevelCells(grid(options_.levels - 1), options_, rim_m_, options_.levels - 1).floor();
  for (int halvings = options_.levels - 1; halvings >= 0; --halvings) {
    const LevelCells cells(grid(halvings), options_, rim_m_, halvings);
    if (content.levels.size() == level_for_places(options_)) {
      const std::vector<Voxel> voxels = cells.all_voxels(content.floor);
      for (const PlaceGrid& place_grid : kPlaceGrids)
        content.place_grids.emplace_back(voxels, place_grid.edge_m, place_grid.spread);
    }
    content.levels.push_back(cells.level(content.floor));
  }
  return content;
}

MapRegions::MapRegions(const maps::MapPackage& map, const MapIndexOptions& options)
    : map_(map), options_(options) {
  for (const maps::TileEntry& entry : map.tiles())
    if (entry.id.level == 0) tiles_[maps::region_of(entry.id)].push_back(entry.id);
  for (auto& [region, tiles] : tiles_) std::sort(tiles.begin(), tiles.end());
}

std::vector<maps::RegionId> MapRegions::regions() const {
  std::vector<maps::RegionId> regions;
  for (const auto& [region, tiles] : tiles_) regions.push_back(region);
  return regions;
}

std::vector<maps::TileId> MapRegions::tiles_around(maps::RegionId region) const {
  const auto reach =
      static_cast<std::int32_t>(std::ceil(RegionBuilder::rim_m(options_) / maps::kTileSizeM));
  const auto is_near = [&](std::int32_t tile, std::int32_t first) {
    return tile >= first - reach && tile < first + maps::kRegionTiles + reach;
  };
  std::vector<maps::TileId> around;
  for (std::int32_t x = region.x - 1; x <= region.x + 1; ++x) {
    for (std::int32_t y = region.y - 1; y <= region.y + 1; ++y) {
      const auto found = tiles_.find({x, y});
      if (found == tiles_.end()) continue;
      for (const maps::TileId tile : found->second)
        if (is_near(tile.x, maps::kRegionTiles * region.x) &&
            is_near(tile.y, maps::kRegionTiles * region.y))
          around.push_back(tile);
    }
  }
  return around;
}

std::string MapRegions::source_of(maps::RegionId region) const {
  maps::Sha256 hash;
  for (const maps::TileId tile : tiles_around(region)) {
    const std::string row =
        fmt::format("{} {} {}\n", tile.x - maps::kRegionTiles * region.x,
                    tile.y - maps::kRegionTiles * region.y, map_.stored_name(tile).sha256);
    hash.add(row.data(), row.size());
  }
  return hash.hex();
}

RegionContent MapRegions::build(maps::RegionId region) const {
  const Eigen::Vector2d corner = corner_of(region);
  const double below_m = below_origin_m(options_);
  RegionBuilder builder(options_);
  for (const maps::TileId id : tiles_around(region)) {
    // The files outlive this process, and nobody compares them with the points again.
    maps::require_whole_tile(map_, id);
    for_each_measured_point(map_, id, [&](const Eigen::Vector3d& p, const maps::MapPoint& point) {
      builder.add({p.x() - corner.x(), p.y() - corner.y(), p.z() + below_m}, weight_of(point));
    });
  }
  return builder.content();
}

std::map<maps::RegionId, RegionContent> build_regions(const std::vector<Eigen::Vector3d>& points,
                                                      const MapIndexOptions& options) {
  std::map<maps::RegionId, RegionBuilder> builders;
  for (const Eigen::Vector3d& p : points) {
    if (!p.allFinite()) throw std::invalid_argument("map points: a point is not finite");
    if (!(p.cwiseAbs().maxCoeff() < kFarthestRegionM)) {
      throw maps::InputError("map points",
                             fmt::format("a point {} m from the origin", p.cwiseAbs().maxCoeff()),
                             fmt::format("less than {} m", kFarthestRegionM));
    }
    builders.try_emplace(region_at(p.x(), p.y()), options);
  }
  const double rim_m = RegionBuilder::rim_m(options);
  for (const Eigen::Vector3d& p : points) {
    const maps::RegionId first = region_at(p.x() - rim_m, p.y() - rim_m);
    const maps::RegionId last = region_at(p.x() + rim_m, p.y() + rim_m);
    for (std::int32_t x = first.x; x <= last.x; ++x) {
      for (std::int32_t y = first.y; y <= last.y; ++y) {
        const auto builder = builders.find({x, y});
        if (builder == builders.end()) continue;
        const Eigen::Vector2d from_corner = p.head<2>() - corner_of({x, y});
        builder->second.add({from_corner.x(), from_corner.y(), p.z()}, 1.0);
      }
    }
  }
  std::map<maps::RegionId, RegionContent> regions;
  for (const auto& [region, builder] : builders) regions.emplace(region, builder.content());
  return regions;
}

}  // namespace stillmap::localization
