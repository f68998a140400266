#pragma once

#include <stillmap/maps/derived_file.hpp>
#include <stillmap/maps/map_package.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <vector>

namespace stillmap::maps {

class TileFile;

/// Levels of detail of a map version, for who looks at it from afar.
///
/// Level 0 are the package's own tiles. A tile of level L holds the points of its four tiles of
/// level L - 1, thinned to one a voxel of `voxel_m(manifest, L)`: the one nearest to the voxel's
/// centre; of those equally near the one of most observations; of those the first in the order of
/// the tiles and in them. So every point of a level is a point of the level below. The highest
/// level is the first that has at most `kFewPoints` points in at most `kFewTiles` tiles.
///
/// Coordinates count from the tile's corner, in floats: points of a map in steps (`tile_steps.hpp`)
/// stay exact up to level 4, and are off by at most half a millimetre up to level 9.
///
/// They lie in a file in the package's folder `levels/`, outside its digest: what is damaged,
/// missing or of another format is made anew. Immutable, safe from several threads.
class MapLevels {
 public:
  static constexpr std::uint64_t kFewPoints = 100'000;
  static constexpr std::size_t kFewTiles = 16;
  /// No map is so wide that it needs a higher level.
  static constexpr std::uint32_t kHighest = 20;

  /// Writes the file, whether there is one or not. Streams tile by tile: memory for each thread is
  /// some 80 bytes for each point of the four largest neighbouring tiles of a level.
  /// @return where it lies.
  /// @throws StorageError when it cannot be written, WorkStopped.
  static std::filesystem::path make(const MapPackage& map, const DerivedWork& work = {});
  /// @throws StorageError when there is none or it cannot be read, InputError when it is damaged,
  /// of another format or of another map: `make` it.
  [[nodiscard]] static std::shared_ptr<const MapLevels> open(const MapPackage& map);
  /// Removes the file, if there is one, so that it is made anew. Who has it open goes on reading.
  static void remove(const MapPackage& map);
  ~MapLevels();
  MapLevels(const MapLevels&) = delete;
  MapLevels& operator=(const MapLevels&) = delete;

  /// The highest level; 0 when the package's own tiles are few.
  [[nodiscard]] std::uint32_t top() const { return top_; }
  /// Those from level 1 on, sorted by id.
  [[nodiscard]] const std::vector<TileEntry>& tiles() const { return tiles_; }
  /// One of `tiles()`; null when there is none.
  [[nodiscard]] const TileEntry* find(TileId id) const;
  /// Points of a tile from level 1 on, from its corner, checked; empty when there is none.
  /// @throws InputError when they are damaged, StorageError.
  [[nodiscard]] std::vector<MapPoint> points(TileId id) const;

  /// Edge of a voxel of a level [m]. A map that does not say its voxel size counts as one of
  /// 0.1 m, a finer one than 1 mm as one of 1 mm.
  [[nodiscard]] static double voxel_m(const MapManifest& manifest, std::uint32_t level);

 private:
  MapLevels();
  std::unique_ptr<const TileFile> file_;
  std::vector<TileEntry> tiles_;
  std::uint32_t top_ = 0;
};

}  // namespace stillmap::maps
