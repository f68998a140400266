#pragma once

#include "cell_blocks.hpp"

#include <stillmap/localization/map_index.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>

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
  [[nodiscard]] Nearest nearest(const Eigen::Vector3f& p, float floor_m2) const {
    Nearest found;
    find_nearest({&p, 1}, floor_m2, &found);
    return found;
  }
  /// Whether any of the eight cells around a point holds a voxel.
  [[nodiscard]] bool has_any_near(const Eigen::Vector3f& p) const;
  /// Calls `take(i, p, nearest)` for the points p = `place(i)`, 0 to count - 1 in that order.
  template <typename Place, typename Take>
  void for_each_nearest(std::size_t count, float floor_m2, const Place& place,
                        const Take& take) const {
    std::array<Eigen::Vector3f, kBatch> points;
    std::array<Nearest, kBatch> found;
    for (std::size_t begin = 0; begin < count; begin += kBatch) {
      const std::size_t size = std::min(kBatch, count - begin);
      for (std::size_t i = 0; i < size; ++i) points[i] = place(begin + i);
      find_nearest(std::span(points).first(size), floor_m2, found.data());
      for (std::size_t i = 0; i < size; ++i) take(begin + i, points[i], found[i]);
    }
  }

  /// Points that are looked up together.
  static constexpr std::size_t kBatch = 32;

 private:
  /// @param points  at most `kBatch`. The same bits on all instruction sets.
  void find_nearest(std::span<const Eigen::Vector3f> points, float floor_m2, Nearest* found) const;
};

/// As `CellBlocks::blocks_of_eight`, of the eight cells nearest to a point; none for a point far
/// from all tiles and for NaN.
inline CellBlocks::Wanted* blocks_near(const CellBlocks& cells, float inverse_edge,
                                       const Eigen::Vector3f& p, std::uint32_t number,
                                       CellBlocks::Wanted* to) {
  // Farther from the window's origin than its cells reach, at 0.1 m, too.
  constexpr float kReachCells = 1 << 14;
  const float x = p.x() * inverse_edge - 0.5F;
  const float y = p.y() * inverse_edge - 0.5F;
  const float z = p.z() * inverse_edge - 0.5F;
  const auto near = [](float at) { return at > -kReachCells && at < kReachCells; };
  if (!near(x) || !near(y) || !near(z)) return to;
  // A cast rounds towards zero, so one less below it; std::floor would be a call. Of a whole number
  // below zero it is the cell before, which is as near.
  const auto rounded_down = [](float at) {
    return static_cast<std::int32_t>(at) -
           static_cast<std::int32_t>(std::bit_cast<std::uint32_t>(at) >> 31);
  };
  return cells.blocks_of_eight(rounded_down(x), rounded_down(y), rounded_down(z), number, to);
}

/// Squared distance of a point to its voxel along the sharp axes [m^2].
[[nodiscard]] inline float across2_m2(const MapIndex::Level::Nearest& nearest,
                                      const Eigen::Vector3f& p) {
  const Voxel& voxel = *nearest.voxel;
  const Eigen::Vector3f offset = p - nearest.mean;
  const float a = voxel.axis0.dot(offset);
  const float b = voxel.sharp_axes == 2 ? voxel.axis1.dot(offset) : 0.0F;
  return a * a + b * b;
}

}  // namespace stillmap::localization
