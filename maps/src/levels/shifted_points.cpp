#include "levels/shifted_points.hpp"

#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <string>

namespace stillmap::maps {
namespace {

/// A point may lie a rounding of its float beside the tile that holds it.
constexpr double kRoundingM = 0.01;
/// And shifted far, some of the shift's own.
constexpr double kShiftRoundingM = 1e-6;
constexpr double kMostShiftM = 1.3e7;

std::int32_t tile_of(double value_m) {
  constexpr double kMost = std::numeric_limits<std::int32_t>::max() - 2.0;
  return static_cast<std::int32_t>(std::clamp(std::floor(value_m / kTileSizeM), -kMost, kMost));
}

struct SeenFree {
  TileEvidence evidence;
  /// Seen free, and without a point.
  TileEvidence::Cubes cubes;
};

SeenFree seen_free(const MapPackage& map, TileId tile) {
  SeenFree seen{map.evidence(tile), {}};
  if (seen.evidence.drives.empty()) return seen;
  seen.cubes = seen.evidence.free();
  const MapTile own = map.tile(tile);
  for (const MapPoint& point : own)
    if (const auto cube = seen.evidence.cube_of(own.from_origin(point) - corner_of(tile)))
      seen.cubes.reset(*cube);
  return seen;
}

}  // namespace

ShiftedPoints::ShiftedPoints(const MapPackage& map, const Eigen::Vector3d& origin)
    : map_(map), shift_(map.manifest().origin - origin) {
  if (shift_.norm() <= kMostShiftM) return;
  throw InputError(map.folder().string(),
                   "an origin " + std::to_string(shift_.norm()) + " m from the other's",
                   "at most " + std::to_string(kMostShiftM) + " m");
}

std::set<std::pair<std::int32_t, std::int32_t>> ShiftedPoints::tiles() const {
  std::set<std::pair<std::int32_t, std::int32_t>> all;
  // Tiles of ours that a tile's extent along one axis meets, whatever its manifest says.
  const auto range = [](std::int32_t index, double min, double max, double shift) {
    const double low = std::max(min, index * kTileSizeM - kRoundingM);
    const double high = std::min(max, (index + 1.0) * kTileSizeM + kRoundingM);
    return std::pair(tile_of(low + shift - kShiftRoundingM * std::abs(shift)),
                     tile_of(high + shift + kShiftRoundingM * std::abs(shift)));
  };
  for (const TileEntry& tile : map_.tiles()) {
    if (tile.id.level != 0) continue;
    const Eigen::AlignedBox3d box = tile.from_origin();
    const auto [x0, x1] = range(tile.id.x, box.min().x(), box.max().x(), shift_.x());
    const auto [y0, y1] = range(tile.id.y, box.min().y(), box.max().y(), shift_.y());
    for (std::int32_t x = x0; x <= x1; ++x)
      for (std::int32_t y = y0; y <= y1; ++y) all.emplace(x, y);
  }
  return all;
}

std::vector<MapPoint> ShiftedPoints::in_tile(std::int32_t x, std::int32_t y,
                                             double margin_m) const {
  const double low_x = x * kTileSizeM - margin_m;
  const double low_y = y * kTileSizeM - margin_m;
  const double width = kTileSizeM + 2.0 * margin_m;
  const Eigen::Vector3d corner = corner_of({.level = 0, .x = x, .y = y});
  std::vector<MapPoint> points;
  for (std::int32_t tx = tile_of(low_x - shift_.x() - kRoundingM);
       tx <= tile_of(low_x + width - shift_.x() + kRoundingM); ++tx) {
    for (std::int32_t ty = tile_of(low_y - shift_.y() - kRoundingM);
         ty <= tile_of(low_y + width - shift_.y() + kRoundingM); ++ty) {
      const MapTile tile = map_.tile({.level = 0, .x = tx, .y = ty});
      for (const MapPoint& own : tile) {
        const Eigen::Vector3d p = tile.from_origin(own) + shift_;
        if (p.x() >= low_x && p.x() < low_x + width && p.y() >= low_y && p.y() < low_y + width &&
            std::isfinite(p.z()))
          points.push_back(moved_to(own, p - corner));
      }
    }
  }
  return points;
}

std::uint32_t ShiftedPoints::count_seen_free(const std::vector<MapPoint>& points, std::int32_t x,
                                             std::int32_t y) const {
  const Eigen::Vector3d corner = corner_of({.level = 0, .x = x, .y = y}) - shift_;
  // A tile of ours has the points of four of theirs at most.
  std::map<TileId, SeenFree> tiles;
  std::uint32_t count = 0;
  for (const MapPoint& point : points) {
    // The middle of a cube may be free above its ground.
    if (point.kind != PointKind::kMeasured) continue;
    const Eigen::Vector3d p = corner + Eigen::Vector3d(point.x, point.y, point.z);
    const TileId tile{.level = 0, .x = tile_of(p.x()), .y = tile_of(p.y())};
    auto known = tiles.find(tile);
    if (known == tiles.end()) known = tiles.emplace(tile, seen_free(map_, tile)).first;
    const auto cube = known->second.evidence.cube_of(p - corner_of(tile));
    count += cube && known->second.cubes[*cube] ? 1 : 0;
  }
  return count;
}

}  // namespace stillmap::maps
