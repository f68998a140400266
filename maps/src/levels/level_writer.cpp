#include "levels/level_writer.hpp"

#include <stillmap/maps/map_levels.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <future>
#include <utility>

#include "levels/voxel_thinning.hpp"

namespace stillmap::maps {
namespace {

TileId parent_of(TileId id) { return {.level = id.level + 1, .x = id.x >> 1, .y = id.y >> 1}; }

/// Rows begin behind the file's header.
bool lies_in_file(const TileRow& row) { return row.offset > 0; }

}  // namespace

LevelWriter::LevelWriter(const MapPackage& map, TileFileWriter& writer, const DerivedWork& work,
                         const std::set<PointKind>& without)
    : map_(map), writer_(writer), work_(work) {
  for (const TileEntry& tile : map.tiles()) {
    if (tile.id.level != 0) continue;
    TileRow row;
    row.x = tile.id.x;
    row.y = tile.id.y;
    row.points = tile.points;
    below_.push_back(row);
  }
  std::sort(below_.begin(), below_.end(),
            [](const TileRow& a, const TileRow& b) { return a.id() < b.id(); });
  // Each level has about a quarter of the points of the one below.
  for (const TileRow& row : below_) to_read_ += static_cast<double>(row.points) * 4.0 / 3.0;
  if (!without.empty()) write_own_level(without);
}

void LevelWriter::write_own_level(const std::set<PointKind>& without) {
  for (const TileRow& row : below_) {
    std::vector<MapPoint> points = map_.tile(row.id()).points_from(corner_of(row.id()));
    std::erase_if(points, [&](const MapPoint& p) { return without.contains(p.kind); });
    if (!points.empty()) writer_.add(row.id(), points);
  }
  below_ = writer_.rows();
}

void LevelWriter::run() {
  for (std::uint32_t level = 1; level <= MapLevels::kHighest && !is_top(); ++level) make_level();
}

bool LevelWriter::is_top() const {
  std::uint64_t points = 0;
  for (const TileRow& row : below_) points += row.points;
  return points <= MapLevels::kFewPoints && below_.size() <= MapLevels::kFewTiles;
}

std::vector<LevelWriter::Parent> LevelWriter::parents() const {
  std::vector<std::pair<TileId, std::size_t>> each;
  for (std::size_t i = 0; i < below_.size(); ++i) each.emplace_back(parent_of(below_[i].id()), i);
  std::sort(each.begin(), each.end());
  std::vector<Parent> all;
  for (const auto& [id, child] : each) {
    if (all.empty() || all.back().id != id) all.push_back({id, {}});
    all.back().children.push_back(child);
  }
  return all;
}

std::vector<MapPoint> LevelWriter::made(const Parent& parent) const {
  std::vector<MapPoint> points;
  for (const std::size_t child : parent.children) {
    const TileRow& row = below_[child];
    MapTile tile = lies_in_file(row)
                       ? MapTile(Eigen::Vector3d::Zero(), corner_of(row.id()), writer_.read(row))
                       : map_.tile(row.id());
    const std::vector<MapPoint> placed = std::move(tile).points_from(corner_of(parent.id));
    points.insert(points.end(), placed.begin(), placed.end());
  }
  return thinned_by_voxel(points, MapLevels::voxel_m(map_.manifest(), parent.id.level));
}

/// As many tiles at a time as there are threads, written in their order.
void LevelWriter::make_level() {
  const std::vector<Parent> all = parents();
  const std::size_t first_row = writer_.rows().size();
  for (std::size_t begin = 0; begin < all.size(); begin += work_.threads) {
    const std::size_t end = std::min(begin + work_.threads, all.size());
    std::vector<std::future<std::vector<MapPoint>>> others;
    for (std::size_t i = begin + 1; i < end; ++i)
      others.push_back(std::async(std::launch::async, [&, i] { return made(all[i]); }));
    std::vector<std::vector<MapPoint>> tiles{made(all[begin])};
    for (auto& other : others) tiles.push_back(other.get());
    for (std::size_t i = begin; i < end; ++i) finish(all[i], tiles[i - begin]);
  }
  below_.assign(writer_.rows().begin() + static_cast<std::ptrdiff_t>(first_row),
                writer_.rows().end());
}

void LevelWriter::finish(const Parent& parent, const std::vector<MapPoint>& points) {
  // Of a tile whose points are all not finite nothing is left.
  if (!points.empty()) writer_.add(parent.id, points);
  for (const std::size_t child : parent.children)
    read_ += static_cast<double>(below_[child].points);
  if (work_.go_on && !work_.go_on(std::min(1.0, read_ / to_read_))) throw WorkStopped();
}

}  // namespace stillmap::maps
