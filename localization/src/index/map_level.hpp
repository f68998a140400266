#pragma once

#include "cell_blocks.hpp"

#include <stillmap/localization/map_index.hpp>

#include <algorithm>
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
  /// Calls `take(i, nearest)` for the points 0 to count - 1 in that order, with `place(i)` the
  /// i-th. Many at a time: each stage's memory is asked for before any of it is used, as
  /// waiting for it is most of the cost.
  template <typename Place, typename Take>
  void for_each_nearest(std::size_t count, float floor_m2, const Place& place,
                        const Take& take) const;

 private:
  /// The first of the eight cells around a point; (-2, -2, -2), whose eight are none, for a point
  /// outside the grid and for NaN.
  [[nodiscard]] Eigen::Array3i first_of_eight(const Eigen::Vector3f& p) const;
  [[nodiscard]] Nearest nearest_of(const CellBlocks::Numbers& numbers, const Eigen::Vector3f& p,
                                   float floor_m2) const;
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

inline Eigen::Array3i MapIndex::Level::first_of_eight(const Eigen::Vector3f& p) const {
  const float inverse = 1.0F / edge_m;
  const float x = p.x() * inverse - 0.5F;
  const float y = p.y() * inverse - 0.5F;
  const float z = p.z() * inverse - 0.5F;
  if (!in_grid(x) || !in_grid(y) || !in_grid(z)) return {-2, -2, -2};
  // What is above -8 is rounded down by a cast once 8 is added; std::floor would be a call.
  return {static_cast<std::int32_t>(x + 8.0F) - 8, static_cast<std::int32_t>(y + 8.0F) - 8,
          static_cast<std::int32_t>(z + 8.0F) - 8};
}

inline MapIndex::Level::Nearest MapIndex::Level::nearest_of(const CellBlocks::Numbers& numbers,
                                                            const Eigen::Vector3f& p,
                                                            float floor_m2) const {
  Nearest best{nullptr, std::numeric_limits<float>::infinity()};
  for (std::size_t k = 0; k < numbers.count; ++k) {
    const Voxel& voxel = voxels[numbers.of[k]];
    const float distance2 = mahalanobis2(voxel, p, floor_m2);
    if (distance2 < best.distance2) best = {&voxel, distance2};
  }
  return best;
}

inline MapIndex::Level::Nearest MapIndex::Level::nearest(const Eigen::Vector3f& p,
                                                         float floor_m2) const {
  const Eigen::Array3i cell = first_of_eight(p);
  return nearest_of(cells.eight(cell.x(), cell.y(), cell.z()), p, floor_m2);
}

template <typename Place, typename Take>
void MapIndex::Level::for_each_nearest(std::size_t count, float floor_m2, const Place& place,
                                       const Take& take) const {
  constexpr std::size_t kBatch = 32;
  std::array<Eigen::Vector3f, kBatch> points;
  std::array<Eigen::Array3i, kBatch> first;
  std::array<CellBlocks::Numbers, kBatch> numbers;
  for (std::size_t begin = 0; begin < count; begin += kBatch) {
    const std::size_t size = std::min(kBatch, count - begin);
    for (std::size_t i = 0; i < size; ++i) {
      points[i] = place(begin + i);
      first[i] = first_of_eight(points[i]);
      cells.prefetch_eight(first[i].x(), first[i].y(), first[i].z());
    }
    for (std::size_t i = 0; i < size; ++i) {
      numbers[i] = cells.eight(first[i].x(), first[i].y(), first[i].z());
      for (std::size_t k = 0; k < numbers[i].count; ++k)
        __builtin_prefetch(&voxels[numbers[i].of[k]]);
    }
    for (std::size_t i = 0; i < size; ++i)
      take(begin + i, nearest_of(numbers[i], points[i], floor_m2));
  }
}

}  // namespace stillmap::localization
