#pragma once

#include "cell_blocks.hpp"

#include <stillmap/localization/map_index.hpp>

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>

namespace stillmap::localization {

/// The points of one voxel as a normal distribution, in principal axes; one cache line.
struct alignas(64) Voxel {
  /// Relative to the index's origin [m].
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

struct MapIndex::Level {
  float edge_m = 0.0F;
  /// Numbers are places in `voxels`.
  CellBlocks cells;
  /// Sorted as `cells` numbers them.
  std::span<const Voxel> voxels;

  /// Voxel that a point [m, relative to origin] most likely belongs to among the eight nearest
  /// cells.
  struct Nearest {
    const Voxel* voxel = nullptr;
    /// Squared Mahalanobis distance with `floor_m2` added to each variance.
    float distance2 = 0.0F;
  };
  [[nodiscard]] Nearest nearest(const Eigen::Vector3f& p, float floor_m2) const;

  /// Whether the cell that holds a point has a voxel.
  [[nodiscard]] bool occupied(const Eigen::Vector3f& p) const;
};

/// Squared Mahalanobis distance of a point to a voxel, `floor_m2` added to each variance.
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

/// Squared distance of a point to its voxel along the sharp axes [m^2].
[[nodiscard]] inline float across2_m2(const Voxel& voxel, const Eigen::Vector3f& p) {
  const Eigen::Vector3f offset = p - voxel.mean;
  const float a = voxel.axis0.dot(offset);
  const float b = voxel.sharp_axes == 2 ? voxel.axis1.dot(offset) : 0.0F;
  return a * a + b * b;
}

/// Whether a coordinate in cells can be cast to int32 and stay near the grid; false for NaN.
[[nodiscard]] inline bool in_grid(float cells) {
  return cells > -8.0F && cells < static_cast<float>(kCellsPerAxis);
}

inline MapIndex::Level::Nearest MapIndex::Level::nearest(const Eigen::Vector3f& p,
                                                         float floor_m2) const {
  const float inverse = 1.0F / edge_m;
  const float fx = p.x() * inverse - 0.5F;
  const float fy = p.y() * inverse - 0.5F;
  const float fz = p.z() * inverse - 0.5F;
  Nearest best;
  if (!in_grid(fx) || !in_grid(fy) || !in_grid(fz)) return best;
  const auto x0 = static_cast<std::int32_t>(std::floor(fx));
  const auto y0 = static_cast<std::int32_t>(std::floor(fy));
  const auto z0 = static_cast<std::int32_t>(std::floor(fz));
  best.distance2 = std::numeric_limits<float>::infinity();
  cells.for_eight(x0, y0, z0, [&](std::uint32_t found) {
    const float distance2 = mahalanobis2(voxels[found], p, floor_m2);
    if (distance2 < best.distance2) best = {&voxels[found], distance2};
  });
  return best;
}

inline bool MapIndex::Level::occupied(const Eigen::Vector3f& p) const {
  const Eigen::Vector3f cell = p / edge_m;
  if (!in_grid(cell.x()) || !in_grid(cell.y()) || !in_grid(cell.z())) return false;
  const auto x = static_cast<std::int32_t>(std::floor(cell.x()));
  const auto y = static_cast<std::int32_t>(std::floor(cell.y()));
  const auto z = static_cast<std::int32_t>(std::floor(cell.z()));
  return is_cell(x, y, z) && cells.find(x, y, z) != CellBlocks::kNone;
}

}  // namespace stillmap::localization
