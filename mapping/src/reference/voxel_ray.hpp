#pragma once

#include <Eigen/Core>

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace stillmap::mapping::reference {

/// The voxel of a point given in voxel edges.
[[nodiscard]] inline Eigen::Vector3i voxel_of(const Eigen::Vector3d& p_voxels) {
  return p_voxels.array().floor().cast<int>();
}

/// Walks along a segment from voxel border to voxel border; who walks keeps the voxel.
///
/// Coordinates are in voxel edges, below 2^30 in size. The walk meets every voxel that the segment
/// crosses and none besides; where it passes exactly through an edge, the axis of the lower number
/// goes first. It can be taken beyond the segment's end, along the same line.
/// @see Amanatides, Woo, "A Fast Voxel Traversal Algorithm for Ray Tracing", Eurographics 1987.
class VoxelRay {
 public:
  VoxelRay(const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
    for (int axis = 0; axis < 3; ++axis) {
      const double way = to[axis] - from[axis];
      const double first = std::floor(from[axis]);
      steps_ += static_cast<int>(std::abs(std::floor(to[axis]) - first));
      const auto k = static_cast<std::size_t>(axis);
      sign_[k] = way < 0.0 ? -1 : 1;
      const double border = way < 0.0 ? first : first + 1.0;
      next_[k] = share((border - from[axis]) / way);
      delta_[k] = share(std::abs(1.0 / way));
    }
  }

  /// Borders between the first voxel and the segment's last.
  [[nodiscard]] int steps() const { return steps_; }
  /// -1 or 1 for each axis.
  [[nodiscard]] int sign(int axis) const { return sign_[static_cast<std::size_t>(axis)]; }

  /// Crosses the next border. @return its axis.
  int advance() {
    if (next_[1] < next_[0]) return next_[2] < next_[1] ? crossed(2) : crossed(1);
    return next_[2] < next_[0] ? crossed(2) : crossed(0);
  }

 private:
  /// Integers, since comparing and adding them is what all the time goes into. 2^-52 of a segment
  /// is as fine as a double; a walk goes no farther than 100 times its length.
  static std::int64_t share(double t) {
    constexpr double kUnit = 0x1p52, kNever = 0x1p59;
    return t * kUnit < kNever ? static_cast<std::int64_t>(t * kUnit)
                              : static_cast<std::int64_t>(kNever);
  }
  int crossed(std::size_t axis) {
    next_[axis] += delta_[axis];
    return static_cast<int>(axis);
  }

  /// Share of the segment at which each axis' next border is crossed, in 2^-52.
  std::array<std::int64_t, 3> next_{};
  std::array<std::int64_t, 3> delta_{};
  std::array<int, 3> sign_{};
  int steps_ = 0;
};

}  // namespace stillmap::mapping::reference
