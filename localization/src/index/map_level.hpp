#pragma once

#include "cell_blocks.hpp"

#include <stillmap/localization/map_index.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>

namespace stillmap::localization {

struct MapIndex::Level {
  float edge_m = 0.0F;
  CellBlocks cells;

  /// Voxel that a point [m, relative to the window's origin] most likely belongs to among the eight
  /// nearest cells.
  struct Nearest {
    const Voxel* voxel = nullptr;
    /// Squared Mahalanobis distance with `floor_m2` added to each variance.
    float distance2 = 0.0F;
    /// Of the voxel, relative to the window's origin [m].
    Eigen::Vector3f mean = Eigen::Vector3f::Zero();
  };
  [[nodiscard]] Nearest nearest(const Eigen::Vector3f& p, float floor_m2) const;
  /// Calls `take(i, nearest)` for the points 0 to count - 1 in that order, with `place(i)` the
  /// i-th. Many at a time: each stage's memory is asked for before any of it is used, as
  /// waiting for it is most of the cost.
  template <typename Place, typename Take>
  void for_each_nearest(std::size_t count, float floor_m2, const Place& place,
                        const Take& take) const;

 private:
  /// The first of the eight cells around a point; far from all tiles for a point far from them and
  /// for NaN.
  [[nodiscard]] Eigen::Array3i first_of_eight(const Eigen::Vector3f& p) const;
  [[nodiscard]] static Nearest nearest_of(const CellBlocks::Eight& eight, const Eigen::Vector3f& p,
                                          float floor_m2);
};

/// Squared distance of a point to its voxel along the sharp axes [m^2].
[[nodiscard]] inline float across2_m2(const MapIndex::Level::Nearest& nearest,
                                      const Eigen::Vector3f& p) {
  const Voxel& voxel = *nearest.voxel;
  const Eigen::Vector3f offset = p - nearest.mean;
  const float a = voxel.axis0.dot(offset);
  const float b = voxel.sharp_axes == 2 ? voxel.axis1.dot(offset) : 0.0F;
  return a * a + b * b;
}

inline Eigen::Array3i MapIndex::Level::first_of_eight(const Eigen::Vector3f& p) const {
  // Farther from the window's origin than its cells reach, at 0.1 m, too.
  constexpr std::int32_t kReach = 1 << 14;
  constexpr auto kReachCells = static_cast<float>(kReach);
  const float inverse = 1.0F / edge_m;
  const float x = p.x() * inverse - 0.5F;
  const float y = p.y() * inverse - 0.5F;
  const float z = p.z() * inverse - 0.5F;
  const auto near = [](float at) { return at > -kReachCells && at < kReachCells; };
  if (!near(x) || !near(y) || !near(z)) return Eigen::Array3i::Constant(-4 * kReach);
  // A cast rounds towards zero, so one less below it; std::floor would be a call. Of a whole number
  // below zero it is the cell before, which is as near.
  const auto rounded_down = [](float at) {
    return static_cast<std::int32_t>(at) -
           static_cast<std::int32_t>(std::bit_cast<std::uint32_t>(at) >> 31);
  };
  return {rounded_down(x), rounded_down(y), rounded_down(z)};
}

inline MapIndex::Level::Nearest MapIndex::Level::nearest_of(const CellBlocks::Eight& eight,
                                                            const Eigen::Vector3f& p,
                                                            float floor_m2) {
  float least2 = std::numeric_limits<float>::infinity();
  if (eight.count == 0) return {nullptr, least2};
  // Nearly always all eight lie in one.
  const CellBlocks::TileView* const tile = eight.tiles[0];
  const Eigen::Vector3f from_corner = p - tile->corner;
  std::size_t best = eight.count;
  for (std::size_t k = 0; k < eight.count; ++k) {
    const float distance2 =
        eight.tiles[k] == tile
            ? mahalanobis2(*eight.voxels[k], from_corner, floor_m2)
            : mahalanobis2(*eight.voxels[k], p - eight.tiles[k]->corner, floor_m2);
    if (!(distance2 < least2)) continue;
    least2 = distance2;
    best = k;
  }
  if (best == eight.count) return {nullptr, least2};
  return {eight.voxels[best], least2, eight.voxels[best]->mean + eight.tiles[best]->corner};
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
  std::array<CellBlocks::Eight, kBatch> found;
  for (std::size_t begin = 0; begin < count; begin += kBatch) {
    const std::size_t size = std::min(kBatch, count - begin);
    for (std::size_t i = 0; i < size; ++i) {
      points[i] = place(begin + i);
      first[i] = first_of_eight(points[i]);
      cells.prefetch_eight(first[i].x(), first[i].y(), first[i].z());
    }
    for (std::size_t i = 0; i < size; ++i) {
      found[i] = cells.eight(first[i].x(), first[i].y(), first[i].z());
      for (std::size_t k = 0; k < found[i].count; ++k) __builtin_prefetch(found[i].voxels[k]);
    }
    for (std::size_t i = 0; i < size; ++i)
      take(begin + i, nearest_of(found[i], points[i], floor_m2));
  }
}

}  // namespace stillmap::localization
