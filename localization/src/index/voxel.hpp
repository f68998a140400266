#pragma once

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cstdint>

namespace stillmap::localization {

/// The points of one voxel as a normal distribution, in principal axes; one cache line.
struct alignas(64) Voxel {
  /// Relative to where the cells of its part of the index begin [m].
  Eigen::Vector3f mean;
  /// Axes of the smallest and of the middle variance (unit); the third is their cross product.
  Eigen::Vector3f axis0, axis1;
  /// Variances along axis0, axis1 and the third axis [m^2], ascending.
  float variance0, variance1, variance2;
  /// How many of the first axes tell where a point is: 1 for a plane, 2 for an upright pole, 0 for
  /// all else (foliage, a lone ring of the sensor), which supports a match but pulls nowhere.
  std::int32_t sharp_axes;
  std::uint32_t points;
  /// Zeros: the struct lies in files as it is.
  std::array<std::uint32_t, 2> unused;
};
static_assert(sizeof(Voxel) == 64);

/// Squared Mahalanobis distance of a point to a voxel, `floor_m2` added to each variance.
/// @param p  [m], relative to what the voxel's mean is relative to.
[[nodiscard]] inline float mahalanobis2(const Voxel& voxel, const Eigen::Vector3f& p,
                                        float floor_m2) {
  const float dx = p.x() - voxel.mean.x();
  const float dy = p.y() - voxel.mean.y();
  const float dz = p.z() - voxel.mean.z();
  const float a = voxel.axis0.x() * dx + voxel.axis0.y() * dy + voxel.axis0.z() * dz;
  const float b = voxel.axis1.x() * dx + voxel.axis1.y() * dy + voxel.axis1.z() * dz;
  const float rest2 = std::max(0.0F, dx * dx + dy * dy + dz * dz - a * a - b * b);
  return a * a / (voxel.variance0 + floor_m2) + b * b / (voxel.variance1 + floor_m2) +
         rest2 / (voxel.variance2 + floor_m2);
}

}  // namespace stillmap::localization
