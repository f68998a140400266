#pragma once

#include <Eigen/Core>

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// A height at a place, with what it counts.
struct HeightSample {
  Eigen::Vector2d p = Eigen::Vector2d::Zero();
  double z = 0.0;
  double weight = 1.0;
};

/// z = plane[0] + plane[1] x + plane[2] y on each side of a straight line; one plane alone when
/// there is no step.
struct SteppedPlane {
  /// Left of the line (normal . p > offset) is 1, else 0; both the same without a step.
  std::array<Eigen::Vector3d, 2> planes = {Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
  bool has_step = false;
  Eigen::Vector2d normal = Eigen::Vector2d::UnitY();
  double offset = 0.0;

  [[nodiscard]] int side_of(const Eigen::Vector2d& p) const {
    return has_step && normal.dot(p) > offset ? 1 : 0;
  }
  [[nodiscard]] double z_at(const Eigen::Vector2d& p, int side) const {
    const Eigen::Vector3d& plane = planes[static_cast<std::size_t>(side)];
    return plane[0] + plane[1] * p.x() + plane[2] * p.y();
  }
  [[nodiscard]] double z_at(const Eigen::Vector2d& p) const { return z_at(p, side_of(p)); }
};

/// Where a step may lie and how the street rises around it.
struct StepBounds {
  /// Half the sides of the rectangle around the origin that a step must cross [m].
  Eigen::Vector2d half_m = Eigen::Vector2d::Ones();
  /// Slopes that both planes are drawn to, as by three samples 1 m away.
  Eigen::Vector2d slope = Eigen::Vector2d::Zero();
};

/// The best plane, or the best two with a straight kerb between them, through heights around a
/// hole.
///
/// All lines through the rectangle are tried, every 5 degrees and 12.5 cm; each side is a weighted
/// least squares plane of its own, its sums read off running sums over the offset. Samples off by
/// more than some centimetres lose their say in a second round. A step is kept when it
///  - halves the squared error at least, and rises by 4 to 35 cm on average within the rectangle,
///  - is seen on both sides within 3 m of the line beyond at least one end of the rectangle.
/// @return nothing with less than 12 samples. Same input, same bits.
[[nodiscard]] std::optional<SteppedPlane> fit_stepped_plane(std::span<const HeightSample> samples,
                                                            const StepBounds& bounds);

}  // namespace stillmap::mapping
