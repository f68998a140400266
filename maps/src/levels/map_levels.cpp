#include <stillmap/maps/map_levels.hpp>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <system_error>
#include <utility>

#include "levels/level_writer.hpp"
#include "levels/tile_file.hpp"

namespace stillmap::maps {
namespace {

constexpr double kUnsaidVoxelM = 0.1;
/// Finer ones no lidar tells apart; every level would hold all points.
constexpr double kFinestVoxelM = 0.001;

std::filesystem::path file_of(const MapPackage& map) {
  return map.folder() / "levels" / "levels.tiles";
}

std::string key_of(const MapPackage& map) { return "levels 1 of " + map.digest(); }

}  // namespace

MapLevels::MapLevels() = default;
MapLevels::~MapLevels() = default;

std::filesystem::path MapLevels::make(const MapPackage& map, const DerivedWork& work) {
  if (work.threads < 1) throw std::invalid_argument("threads: 0, >= 1");
  TileFileWriter writer(file_of(map), key_of(map));
  LevelWriter(map, writer, work).run();
  writer.publish();
  return file_of(map);
}

std::shared_ptr<const MapLevels> MapLevels::open(const MapPackage& map) {
  std::shared_ptr<MapLevels> levels(new MapLevels);
  levels->file_ = std::make_unique<const TileFile>(file_of(map), key_of(map));
  for (const TileRow& row : levels->file_->rows()) levels->tiles_.push_back(row.entry(row.id()));
  if (!levels->tiles_.empty()) levels->top_ = levels->tiles_.back().id.level;
  return levels;
}

void MapLevels::remove(const MapPackage& map) {
  std::error_code ignored;
  std::filesystem::remove(file_of(map), ignored);
}

const TileEntry* MapLevels::find(TileId id) const {
  const auto found =
      std::lower_bound(tiles_.begin(), tiles_.end(), id,
                       [](const TileEntry& tile, TileId wanted) { return tile.id < wanted; });
  return found != tiles_.end() && found->id == id ? &*found : nullptr;
}

std::vector<MapPoint> MapLevels::points(TileId id) const {
  const TileRow* row = file_->find(id);
  return row == nullptr ? std::vector<MapPoint>{} : file_->read(*row);
}

double MapLevels::voxel_m(const MapManifest& manifest, std::uint32_t level) {
  const double finest = manifest.voxel_size_m > 0.0 ? manifest.voxel_size_m : kUnsaidVoxelM;
  return std::ldexp(std::max(finest, kFinestVoxelM), static_cast<int>(level));
}

}  // namespace stillmap::maps
