#pragma once

#include "catalog/map_catalog.hpp"

#include <Eigen/Core>

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace stillmap::server {

/// What a vehicle asks to have around it.
struct TileDiffRequest {
  /// In the map frame [m].
  Eigen::Vector2d centre_map = Eigen::Vector2d::Zero();
  double radius_m = 0.0;
  std::uint32_t level = 0;
  /// Ids of the tiles that it has, as `TileDiff` gave them.
  std::vector<std::string> cached_ids;
};

struct TileDiff {
  struct Added {
    std::string id;
    maps::TileEntry tile;
    /// Added to the coordinates of its points gives the map frame [m].
    Eigen::Vector3d corner_map = Eigen::Vector3d::Zero();
    std::string url;
  };
  std::string version;
  std::vector<Added> add;
  /// In the order in which they were sent, each once.
  std::vector<std::string> remove;
};

/// Most tile widths that a radius may be: 50 of 20 m are 1 km, at most some 8,000 tiles.
inline constexpr double kMaxDiffWidths = 50.0;
/// More than such a circle holds, with room for those left behind.
inline constexpr std::size_t kMaxCachedIds = 20'000;
/// Deeper levels have tiles beyond the size of the Earth.
inline constexpr std::uint32_t kMaxDiffLevel = 20;

/// Tiles whose square meets the circle and that are not cached, and what is cached but not among
/// those, as Autoware's GetDifferentialPointCloudMap. An id names its version
/// (`version/level/x/y`), so that another version replaces every tile.
[[nodiscard]] TileDiff tile_diff(const ServedVersion& map, const TileDiffRequest& request);

}  // namespace stillmap::server
