#pragma once

#include <stillmap/maps/map_levels.hpp>
#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::maps {

/// A map's levels of detail as a tileset of 3D Tiles 1.1 (OGC 22-025r4): an explicit tree in which
/// finer tiles take the place of coarser ones (REPLACE), boxes from the true bounds of what lies
/// below, geometric error = voxel size of the level, 0 at level 0. Tiles are `LEVEL/X/Y.glb`
/// relative to the tileset, coordinates relative to the map's origin [m], z up.
///
/// A tree of more than `kMostTiles` tiles is cut below levels 5, 10, ...: each tile there gets a
/// tileset of its own, `LEVEL/X/Y.json`, of at most 1,364 tiles. Immutable, safe from several
/// threads.
class Tileset {
 public:
  static constexpr std::size_t kMostTiles = 4096;
  static constexpr std::uint32_t kCutEvery = 5;

  /// Of a map as it is. @throws InputError when the levels are not those of the map.
  Tileset(const MapPackage& map, const MapLevels& levels);
  /// Of these tiles, level 0 and all above it. @param map  for its voxels, its origin and its name.
  Tileset(const MapPackage& map, std::vector<TileEntry> tiles);

  /// `tileset.json`. @param T_world_origin  where the map's origin is in what shows it; it stays
  /// where it is without.
  [[nodiscard]] std::string text(const std::optional<Eigen::Matrix4d>& T_world_origin = {}) const;
  /// Tiles that have a tileset of their own, sorted; none in most maps.
  [[nodiscard]] const std::vector<TileId>& cuts() const { return cuts_; }
  /// The tileset of one of `cuts()`. @throws std::invalid_argument for another tile.
  [[nodiscard]] std::string cut_text(TileId id) const;

 private:
  struct Node {
    /// Of all that lies below, down to level 0.
    Eigen::AlignedBox3d box;
    std::vector<TileId> children;
  };
  /// @return whether there are any.
  bool adopt_children(TileId id, Node& node);
  [[nodiscard]] double error_m(std::uint32_t level) const;
  [[nodiscard]] std::string box_text(const Eigen::AlignedBox3d& box) const;
  /// Appends `id` and what lies below it down to the next cut. @param base  leads from the
  /// tileset's folder to that of all tiles.
  void append(std::string& text, TileId id, const std::string& base) const;
  void append_children(std::string& text, TileId id, const std::string& base) const;
  [[nodiscard]] bool is_cut(TileId id) const;
  [[nodiscard]] std::string extras() const;

  std::map<TileId, Node> nodes_;
  std::vector<TileId> roots_;
  std::vector<TileId> cuts_;
  std::vector<std::uint64_t> points_of_level_;
  double voxel_m_ = 0.0;
  Eigen::Vector3d origin_ = Eigen::Vector3d::Zero();
  std::string digest_;
};

}  // namespace stillmap::maps
