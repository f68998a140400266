#pragma once

#include <stillmap/maps/box.hpp>
#include <stillmap/maps/scan.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// The grid of the fused ground: square cells of the local frame (the map frame less the map's
/// origin), in blocks of 16 x 16.
inline constexpr double kGroundCellM = 0.25;
inline constexpr int kGroundBlockCells = 16;
/// Cells this far from the origin are left out: 262 km.
inline constexpr int kMaxGroundCell = 1 << 20;

/// @param value  finite.
[[nodiscard]] inline int ground_cell_of(double value) {
  const double cell = std::floor(value / kGroundCellM);
  return static_cast<int>(std::fmax(-2.0 * kMaxGroundCell, std::fmin(2.0 * kMaxGroundCell, cell)));
}
[[nodiscard]] inline double ground_cell_centre(int cell) { return (cell + 0.5) * kGroundCellM; }

/// The ground of one scan, a few numbers a cell.
struct GroundCells {
  struct Cell {
    std::int32_t x = 0;
    std::int32_t y = 0;
    /// Mean of a layer's points, local frame [m], and where that mean lies from the cell's centre.
    float z = 0.0F;
    float offset_x = 0.0F;
    float offset_y = 0.0F;
    /// 1 = several points near the sensor.
    float weight = 0.0F;
    /// Whether the points lay in a box, where tyres and undersides are taken for ground.
    bool in_box = false;
  };
  /// By block, then by cell, then upward; several in a cell that holds several layers.
  std::vector<Cell> cells;
};

/// Reduces a scan's ground to cells; the parallel half of fusing the ground.
///
/// A point weighs s0^2 / (s0^2 + (s1 r)^2) with s0 = 2 cm and s1 = 0.002: at range r an error of
/// the pose's or a laser's pitch of 0.1 degrees lifts a point by some 0.002 r.
/// @param cloud      N points, lidar frame [m], all finite.
/// @param is_ground  N flags, 1 = ground.
/// @param boxes      objects found in that scan, lidar frame; may be empty.
/// @throws std::invalid_argument when the sizes differ.
/// @note Pure, so safe from several threads. Same input, same bits.
[[nodiscard]] GroundCells reduce_ground(const maps::PointCloud& cloud,
                                        const std::vector<std::uint8_t>& is_ground,
                                        std::span<const maps::Box> boxes,
                                        const Eigen::Isometry3d& T_local_lidar);

}  // namespace stillmap::mapping
