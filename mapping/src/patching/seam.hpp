#pragma once

#include "patching/tile_merge.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <cstddef>
#include <optional>
#include <span>

namespace stillmap::mapping {

/// How far the surfaces of new drives are off from those of a map, in a quarter of a tile.
struct SeamFit {
  /// Middle of the points, from the tile's corner [m].
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  /// From the map's surfaces to the new ones, along the directions that they tell of [m].
  Eigen::Vector3d off_m = Eigen::Vector3d::Zero();
  /// Deviation of that along it [m]. The points in a square of 1 m share their error: a bush, a
  /// kerb, what has changed.
  double sigma_m = 0.0;
  /// Takes the part of a vector along the directions that the surfaces tell of.
  Eigen::Matrix3d told = Eigen::Matrix3d::Zero();
  std::size_t points = 0;

  /// What the surfaces are off by at least [m].
  [[nodiscard]] double sure_m() const { return std::max(0.0, off_m.norm() - 3.0 * sigma_m); }
};

/// One shift between the measured surfaces of two tiles: point to plane, with the normals of the
/// map's points, and a Cauchy kernel of 3 cm for what has changed. Directions across which less
/// than a tenth of the points lie, or those of fewer than four squares, are left out: no surface
/// tells of them. The deviation is that of
/// Huber's sandwich, clustered by squares.
/// @param quarter  0 to 3: low or high x, then low or high y.
/// @return nothing where fewer than 100 points lie on a surface of the map: there is none to fit.
[[nodiscard]] std::optional<SeamFit> seam_between(const TileOfMap& before, const TileOfMap& now,
                                                  int quarter);

/// What the new surfaces are off by around a place: what is sure there, and not more than the
/// median of the places within 15 m that tell of this direction to a centimetre. Wrong poses move
/// all that is near; a hedge that is seen from another side moves alone.
/// @param fits  by `middle.x()`, in one frame. @return 0 where no second place tells of it [m].
[[nodiscard]] Eigen::Vector3d shared_shift_m(const SeamFit& place, std::span<const SeamFit> fits);

}  // namespace stillmap::mapping
