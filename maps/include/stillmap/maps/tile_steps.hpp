#pragma once

#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>

namespace stillmap::maps {

/// Steps of the coordinates of map points: 20 m / 2^16 in x and y, counted from the tile's corner,
/// and 2^-11 m in z, counted from whole metres. A coordinate is the middle of its step, so it is
/// off by at most half of one: 0.15 mm in x and y, 0.25 mm in z, 0.33 mm in all. (A build takes the
/// next step where the middle lies in another voxel than the point, less than twice as far off.)
/// Relative to the tile each is exact in a float.
inline constexpr double kTileStepM = kTileSizeM / 65536.0;
inline constexpr double kTileStepZM = 1.0 / 2048.0;

/// A coordinate in a tile [m] -> the middle of its step. What lies outside of [0, 20 m) by a
/// rounding is taken for the first or last step.
[[nodiscard]] float in_tile_steps(double value_m);
/// A height above a whole metre [m] -> the middle of its step.
/// @throws std::invalid_argument beyond 2^30 steps.
[[nodiscard]] float in_height_steps(double value_m);

/// An intensity as packages hold it: 11 bits of mantissa, at most 65,504 (IEEE 754 binary16).
[[nodiscard]] float in_intensity_steps(float intensity);

/// A point -> the middle of its steps: x, y from the tile's corner, z from a whole metre [m].
[[nodiscard]] Eigen::Vector3f in_steps(const Eigen::Vector3d& p_tile);

/// The same of a point in a voxel, which it does not leave: where the middle of its step lies
/// outside, the next step. @param begin  lower corner of the voxel, as `p_tile` [m].
[[nodiscard]] Eigen::Vector3f in_steps_of_voxel(const Eigen::Vector3d& p_tile,
                                                const Eigen::Vector3d& begin, double voxel_size_m);

}  // namespace stillmap::maps
