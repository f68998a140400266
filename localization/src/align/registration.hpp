#pragma once

#include "index/map_level.hpp"
#include "residual_rows.hpp"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstddef>
#include <limits>
#include <span>
#include <vector>

namespace stillmap::localization {

/// Where the map is bent, what is near decides: a surface at range r was mapped from places up to r
/// away, and GNSS-aided poses of a city drive slid sideways by 0.44 m in 11 m.
inline constexpr float kBendShare = 0.015F;

/// Variance of a residual along a sharp axis [m^2]: the surface's thickness, and a share of the
/// range for what bends between here and there (0 where the map is straight).
[[nodiscard]] inline float row_variance_m2(float surface_variance_m2, float range2_m2,
                                           float bend_share) {
  return surface_variance_m2 + bend_share * bend_share * range2_m2;
}

/// The voxel that tells where a point is: null when that of the point has no sharp axis, or the
/// point lies past its surface's end.
/// @param nearest  of `p` [m, relative to the window's origin] with `kernel_variance_m2(kernel_m)`.
[[nodiscard]] const Voxel* sharp_match(const MapIndex::Level::Nearest& nearest,
                                       const Eigen::Vector3f& p, float kernel_m);

/// Which voxel each point lies on, kept from round to round: a point is looked up again only when
/// the pose has moved it by a tenth of the kernel's width since.
class Matches {
 public:
  /// @param points_lidar  [m]; must outlive this. Every `stride`-th is used.
  Matches(const MapIndex::Level& level, std::span<const Eigen::Vector3f> points_lidar,
          std::size_t stride = 1);

  /// Rows at a pose, one for each sharp axis of a point's voxel.
  /// @param T_index_lidar  relative to the window's origin.
  [[nodiscard]] const ResidualRows& at(const Eigen::Isometry3d& T_index_lidar, float kernel_m,
                                       float bend_share = 0.0F);

 private:
  struct Match {
    const Voxel* voxel = nullptr;
    /// Of the voxel, relative to the window's origin [m].
    Eigen::Vector3f mean = Eigen::Vector3f::Zero();
    /// Where the point was when it was looked up; far from everywhere at first.
    Eigen::Vector3f at = Eigen::Vector3f::Constant(std::numeric_limits<float>::infinity());
  };
  const MapIndex::Level& level_;
  std::span<const Eigen::Vector3f> points_lidar_;
  std::size_t stride_;
  std::vector<Match> matches_;
  std::vector<std::size_t> moved_;
  ResidualRows rows_;
};

/// From a wide kernel to a narrow one: each round matches the points anew, then takes Gauss-Newton
/// steps with the matches held fast.
struct Schedule {
  /// Kernels of the rounds [m]; the last one is used until the pose stands still.
  float first_kernel_m = 1.0F;
  float last_kernel_m = 0.3F;
  /// Every `stride`-th point is used, >= 1.
  std::size_t stride = 1;
  /// >= 1
  int max_rounds = 6;
  /// See `row_variance_m2`, >= 0.
  float bend_share = 0.0F;
};

/// Graduated non-convexity (Yang et al., "Graduated non-convexity for robust spatial perception",
/// RA-L 2020): the kernel narrows by a constant factor from round to round, so that what is far
/// pulls first and what is wrong lets go later. Ends when a round at the last kernel moves the pose
/// by less than a millimetre, or after `max_rounds`. Directions that the points do not constrain
/// are left where they are (Zhang, Kaess, Singh, "On degeneracy of optimization-based state
/// estimation problems", ICRA 2016). @return the number of Gauss-Newton steps.
int refine(const MapIndex::Level& level, std::span<const Eigen::Vector3f> points_lidar,
           const Schedule& schedule, Eigen::Isometry3d& T_index_lidar);

/// Rotations are compared with translations over this lever [m]: a typical distance of what is
/// seen.
inline constexpr double kLeverM = 15.0;
/// Units in which the six of a pose compare.
inline const Vector6d kUnitsOfPose =
    (Vector6d() << 1.0, 1.0, 1.0, 1.0 / kLeverM, 1.0 / kLeverM, 1.0 / kLeverM).finished();
/// H with rotations scaled to metres at the lever, so that its eigenvalues compare.
[[nodiscard]] Matrix6d in_metres(const Matrix6d& H);
/// A covariance in those units with its rotations back in radians.
[[nodiscard]] Matrix6d out_of_metres(const Matrix6d& covariance);
/// Gauss-Newton step, zero along the eigenvectors of `in_metres(H)` whose eigenvalue is at most
/// this share of the largest.
[[nodiscard]] Vector6d bounded_step(const NormalEquations& system, double min_eigenvalue_share);

}  // namespace stillmap::localization
