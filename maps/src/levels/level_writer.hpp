#pragma once

#include <stillmap/maps/derived_file.hpp>
#include <stillmap/maps/map_package.hpp>

#include <cstddef>
#include <set>
#include <vector>

#include "levels/tile_file.hpp"

namespace stillmap::maps {

/// Writes a map's levels of detail (`MapLevels` says what they are), each from the one below.
class LevelWriter {
 public:
  /// @param writer   empty. @param without  kinds of points that count as if they were not there;
  /// where there are any, level 0 is written too, since it is not the map's own then. All of it
  /// outlives this.
  LevelWriter(const MapPackage& map, TileFileWriter& writer, const DerivedWork& work,
              const std::set<PointKind>& without = {});
  /// @throws StorageError, WorkStopped.
  void run();

 private:
  /// A tile to be made: its children are `below_[i]`.
  struct Parent {
    TileId id;
    std::vector<std::size_t> children;
  };
  [[nodiscard]] bool is_top() const;
  [[nodiscard]] std::vector<Parent> parents() const;
  [[nodiscard]] std::vector<MapPoint> made(const Parent& parent) const;
  void write_own_level(const std::set<PointKind>& without);
  void make_level();
  void finish(const Parent& parent, const std::vector<MapPoint>& points);

  const MapPackage& map_;
  TileFileWriter& writer_;
  const DerivedWork& work_;
  /// The level that the next one is made from, sorted. Its tiles of group 0 are the map's own where
  /// they have no place in the file.
  std::vector<TileRow> below_;
  double to_read_ = 0.0;
  double read_ = 0.0;
};

}  // namespace stillmap::maps
