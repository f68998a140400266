#include <stillmap/maps/tile_layer.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <utility>
#include <vector>

namespace stillmap::maps {
namespace {

constexpr std::size_t kMostCells = 1'000'000;
constexpr std::size_t kFinestPerSide = 20;
constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

/// A scan that saw something in a cell.
struct Seen {
  std::size_t cell = 0;
  std::uint32_t scan = 0;
  auto operator<=>(const Seen&) const = default;
};

void count_scans(std::vector<Seen>& seen, std::span<float> scans) {
  std::sort(seen.begin(), seen.end());
  seen.erase(std::unique(seen.begin(), seen.end()), seen.end());
  std::fill(scans.begin(), scans.end(), 0.0F);
  for (const Seen& each : seen) scans[each.cell] += 1.0F;
}

/// Values of one tile.
struct TileBands {
  std::span<float> height, observations, scans;
};

void fill(const MapPackage& map, const TileId& id, std::size_t side, const TileBands& bands) {
  const MapTile tile = map.tile(id);
  const std::vector<PointHistory> history = map.history(id);
  std::vector<Seen> seen;
  for (std::size_t i = 0; i < tile.size(); ++i) {
    const MapPoint& point = tile[i];
    const Eigen::Vector3d p = tile.from_origin(point);
    const std::size_t cell = cell_of(id, side, p.x(), p.y());
    const auto height = static_cast<float>(p.z());
    // NaN is no number that a height could be below.
    if (!(bands.height[cell] <= height)) bands.height[cell] = height;
    if (std::isnan(bands.observations[cell])) bands.observations[cell] = 0.0F;
    if (!is_measured(point.kind)) continue;
    bands.observations[cell] += static_cast<float>(point.observations);
    if (history.empty()) continue;
    seen.push_back({.cell = cell, .scan = history[i].first_scan});
    if (history[i].last_scan != history[i].first_scan)
      seen.push_back({.cell = cell, .scan = history[i].last_scan});
  }
  if (bands.scans.empty()) return;
  count_scans(seen, bands.scans);
  for (std::size_t cell = 0; cell < bands.height.size(); ++cell)
    if (std::isnan(bands.height[cell])) bands.scans[cell] = kNone;
}

bool has_histories(const MapPackage& map, const std::vector<TileId>& tiles) {
  return std::any_of(tiles.begin(), tiles.end(),
                     [&](const TileId& tile) { return map.has_history(tile); });
}

}  // namespace

std::size_t cells_per_side(std::size_t tiles, std::size_t most) {
  std::size_t side = most;
  while (side > 1 && side * side * tiles > kMostCells) side = side % 2 == 0 ? side / 2 : 1;
  return side;
}

std::size_t cell_of(const TileId& tile, std::size_t cells_per_side, double x, double y) {
  const auto along = [&](double value, std::int32_t number) {
    const double in_tile = value - kTileSizeM * number;
    const double cell = std::floor(in_tile * static_cast<double>(cells_per_side) / kTileSizeM);
    // What was rounded to a float may lie a step outside of its tile.
    return static_cast<std::size_t>(std::clamp(cell, 0.0, static_cast<double>(cells_per_side - 1)));
  };
  return along(y, tile.y) * cells_per_side + along(x, tile.x);
}

std::vector<TileId> finest_tiles(const MapPackage& map) {
  std::vector<TileId> tiles;
  for (const TileEntry& tile : map.tiles())
    if (tile.id.level == 0) tiles.push_back(tile.id);
  std::sort(tiles.begin(), tiles.end());
  return tiles;
}

std::optional<TileLayer> coverage_of(const MapPackage& map, const GoOn& go_on) {
  TileLayer layer;
  layer.tiles = finest_tiles(map);
  layer.cells_per_side = cells_per_side(layer.tiles.size(), kFinestPerSide);
  const std::size_t cells = layer.cells_per_tile();
  const std::vector<float> none(cells * layer.tiles.size(), kNone);
  layer.bands = {{.name = "height", .unit = "m", .values = none},
                 {.name = "observations", .unit = "", .values = none}};
  if (has_histories(map, layer.tiles))
    layer.bands.push_back({.name = "scans", .unit = "", .values = none});
  for (std::size_t i = 0; i < layer.tiles.size(); ++i) {
    if (go_on && !go_on()) return std::nullopt;
    const auto values = [&](std::size_t band) {
      return std::span(layer.bands[band].values).subspan(i * cells, cells);
    };
    fill(map, layer.tiles[i], layer.cells_per_side,
         {.height = values(0),
          .observations = values(1),
          .scans = layer.bands.size() > 2 ? values(2) : std::span<float>{}});
  }
  return layer;
}

}  // namespace stillmap::maps
