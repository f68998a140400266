#pragma once

#include <stillmap/localization/map_index.hpp>
#include <stillmap/maps/tile_layer.hpp>

#include <optional>

namespace stillmap::localization {

/// How well the map constrains a scan that is taken at a place, for places where a sensor can be,
/// in cells of 5 m (coarser where a map has more than 62,500 tiles).
///
/// The information about (x, y, yaw) of a scan that is matched there with the map's planes and
/// posts: M = sum w J J^T over the voxels of a metre within 50 m, with J = (g_x,
/// g_y, (r x g)_z / 15 m) of each one's sharpest axis g at r from the sensor. This is Fisher's
/// information of such a match (Censi, "On achievable accuracy for range-finder localization", ICRA
/// 2007), and its smallest eigenvalue the degeneracy factor of Zhang, Kaess and Singh ("On
/// degeneracy of optimization-based state estimation problems", ICRA 2016). Weights: w = min(1,
/// beams of a sensor with 1024 columns and 64 rings over 45 degrees that hit it), since the aligner
/// thins what is denser; voxels above or below these rings, and behind the nearest upright plane at
/// the sensor's height in their two degrees, count for nothing. What the noise of normals feigns
/// (`noise_information.hpp`), taken 3.5 times as the verdict does, is taken off.
///
/// - `height` [m, relative to the manifest's origin]: lowest ground of the cell (lowest point where
///   the map knows of no ground); the sensor stands as high above it as those that made the map did
///   in the median, else 1.8 m.
/// - `localizability` in [0, 1]: 3 (e - 3.5 f) / max(trace M, 300), with e the smallest eigenvalue
///   and f the information that noise alone would show along its vector: 1 where surfaces face all
///   directions alike, 0 where the scan can move along some direction without a worse fit, and less
///   than 1 where there is little to see.
/// - `weak_direction` [rad, from +x of the map frame towards +y, in (-pi/2, pi/2]]: horizontal
///   direction that is constrained least; NaN if the weakest motion is a turn.
///
/// It is computed from the map alone: moving objects and the points of a real scan are not in it.
/// @param go_on  as `maps::coverage_of`. @return nothing if it was stopped.
/// @throws maps::InputError for trajectories that cannot be read.
/// @note Reads every point. Same map, same bits.
[[nodiscard]] std::optional<maps::TileLayer> localizability_of(const maps::MapPackage& map,
                                                               const MapIndex& index,
                                                               const maps::GoOn& go_on = {});

}  // namespace stillmap::localization
