#pragma once

#include "patching/tile_merge.hpp"

#include <Eigen/Core>

#include <cstddef>
#include <optional>

namespace stillmap::mapping {

/// How far the surfaces of new drives are off from those of a map, in a quarter of a tile.
struct SeamFit {
  /// Middle of the points, from the tile's corner [m].
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  /// From the map's surfaces to the new ones, along the directions that they tell of [m].
  Eigen::Vector3d off_m = Eigen::Vector3d::Zero();
  std::size_t points = 0;
};

/// One shift between the measured surfaces of two tiles: point to plane, with the normals of the
/// map's points, and a Cauchy kernel of 3 cm for what has changed. Directions across which less
/// than a tenth of the points lie are left out: no surface tells of them.
/// @param quarter  0 to 3: low or high x, then low or high y.
/// @return nothing where fewer than 100 points lie on a surface of the map: there is none to fit.
[[nodiscard]] std::optional<SeamFit> seam_between(const TileOfMap& before, const TileOfMap& now,
                                                  int quarter);

}  // namespace stillmap::mapping
