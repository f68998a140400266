#pragma once

#include <stillmap/maps/map_package.hpp>

#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::maps {

/// Values over the ground of a map, for the squares of its tiles of level 0 that hold points.
struct TileLayer {
  /// One value a cell.
  struct Band {
    std::string name;
    /// "m", "rad"; empty for numbers without.
    std::string unit;
    /// `cells_per_side` squared a tile, in the order of `tiles`; within a tile row after row, y
    /// ascending, x ascending within a row. NaN where there is none.
    std::vector<float> values;
  };
  /// Cells along each side of a tile, so that a cell's edge is `kTileSizeM / cells_per_side`.
  std::size_t cells_per_side = 1;
  /// Ascending.
  std::vector<TileId> tiles;
  std::vector<Band> bands;

  [[nodiscard]] double cell_m() const { return kTileSizeM / static_cast<double>(cells_per_side); }
  [[nodiscard]] std::size_t cells_per_tile() const { return cells_per_side * cells_per_side; }
};

/// Asked now and then while something slow goes on; false = stop. Empty = go on to the end.
using GoOn = std::function<bool()>;

/// How often places of a map were seen, in cells of a metre; of two or more where a map has more
/// than 2,500 tiles, so that there are at most a million.
///
/// - `height` [m, relative to the manifest's origin]: lowest point of the cell.
/// - `observations`: of its measured points, summed; each saturates at 65,535.
/// - `scans`: scans that were the first or the last one to see one of them, each once: at least so
///   many saw the cell. Absent where the package has no histories (a map from elsewhere).
/// @return nothing when it was told to stop.
/// @note Reads every point.
[[nodiscard]] std::optional<TileLayer> coverage_of(const MapPackage& map, const GoOn& go_on = {});

/// Tiles of level 0, ascending.
[[nodiscard]] std::vector<TileId> finest_tiles(const MapPackage& map);

/// The most cells along a tile's side, of those that divide `most` by two again and again, for
/// which so many tiles have at most a million.
[[nodiscard]] std::size_t cells_per_side(std::size_t tiles, std::size_t most);

/// The cell of its tile that a point relative to the map's origin lies in [m].
[[nodiscard]] std::size_t cell_of(const TileId& tile, std::size_t cells_per_side, double x,
                                  double y);

}  // namespace stillmap::maps
