#pragma once

#include "map_level.hpp"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstddef>
#include <span>

namespace stillmap::localization {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// How sharply one pass looks at the map.
struct Focus {
  /// Distance to a surface at which a point has a quarter of its weight (Geman-McClure) [m], > 0.
  float kernel_m = 0.5F;
  /// Every `stride`-th point is used, >= 1.
  std::size_t stride = 1;
};

/// Gauss-Newton system of one linearisation: H step = -gradient.
struct NormalEquations {
  Matrix6d H = Matrix6d::Zero();
  Vector6d gradient = Vector6d::Zero();
  /// Sum of the robust costs; a point without a match costs the kernel's limit.
  double cost = 0.0;
  std::size_t matched = 0;
};

/// Distance of one point to its voxel along a sharp axis, and its derivative.
struct AxisResidual {
  /// axis . (T p - mean) [m]
  double residual_m = 0.0;
  /// Derivative for T exp(xi), xi = (tx ty tz rx ry rz) in the lidar frame: [R^T axis, p x R^T
  /// axis].
  Vector6d jacobian = Vector6d::Zero();
};
[[nodiscard]] AxisResidual axis_residual(const Eigen::Vector3d& axis, const Eigen::Vector3d& mean,
                                         const Eigen::Isometry3d& T,
                                         const Eigen::Vector3d& p_lidar);

/// What one point contributes: robust weight, and weighted residuals along up to two axes.
struct PointTerm {
  const Voxel* voxel = nullptr;
  /// Squared distance along the sharp axes [m^2].
  float distance2_m2 = 0.0F;
  /// Derivative of half the robust cost with respect to distance2, in (0, 1].
  float robust_weight = 0.0F;
};

/// Variance of a residual along a sharp axis [m^2]: the surface's thickness, the kernel's width and
/// what grows with the range. A surface at range r was mapped from places up to r away from here,
/// and between those the map's poses drift: GNSS-aided poses of a city drive slid sideways by 3 to
/// 5 % of the way. So what is near decides, and what is far helps as long as the map is straight.
[[nodiscard]] inline float residual_variance_m2(float surface_variance_m2, float kernel_m,
                                                float range2_m2) {
  constexpr float kDriftShare = 0.05F;
  return surface_variance_m2 + kernel_m * kernel_m / 9.0F + kDriftShare * kDriftShare * range2_m2;
}

/// Finds the voxel of one point; `voxel` is null when nothing sharp is near.
[[nodiscard]] PointTerm match_point(const MapIndex::Level& level, const Eigen::Vector3f& p,
                                    float kernel_m);

/// Sums the terms of all points. @param T_index_lidar  relative to the index's origin.
[[nodiscard]] NormalEquations linearize(const MapIndex::Level& level,
                                        std::span<const Eigen::Vector3f> points_lidar,
                                        const Eigen::Isometry3d& T_index_lidar, const Focus& focus);

/// Gauss-Newton until the step is below a millimetre or `max_iterations`; directions that the
/// points do not constrain are left where they are (Zhang, Kaess, Singh, "On degeneracy of
/// optimization-based state estimation problems", ICRA 2016). @return the number of iterations.
int refine(const MapIndex::Level& level, std::span<const Eigen::Vector3f> points_lidar,
           const Focus& focus, int max_iterations, Eigen::Isometry3d& T_index_lidar);

/// Rotations are compared with translations over this lever [m]: a typical distance of what is
/// seen.
inline constexpr double kLeverM = 15.0;
/// H with rotations scaled to metres at the lever, so that its eigenvalues compare.
[[nodiscard]] Matrix6d in_metres(const Matrix6d& H);

}  // namespace stillmap::localization
