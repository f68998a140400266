#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstddef>
#include <vector>

namespace stillmap::localization {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// Gauss-Newton system of one linearisation: H step = -gradient, for T exp(step) with step = (tx ty
/// tz rx ry rz) in the lidar frame.
struct NormalEquations {
  Matrix6d H = Matrix6d::Zero();
  Vector6d gradient = Vector6d::Zero();
  /// Sum of the robust costs of the rows [m^2].
  double cost = 0.0;
};

/// Floats in the longest vector that is used; columns are padded to a multiple of it.
inline constexpr std::size_t kMostLanes = 16;

/// Point-to-plane residuals with their matches held fast, a column for each quantity so that the
/// sums are taken many rows at a time. Row i: normal . (R point + t - centre) - offset.
struct ResidualRows {
  /// What offsets are relative to, so that floats keep their micrometres in a map of many
  /// kilometres [m].
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  std::vector<float> point_x, point_y, point_z;     ///< in the lidar frame [m]
  std::vector<float> normal_x, normal_y, normal_z;  ///< in the map, unit
  std::vector<float> offset;                        ///< normal . (mean - centre) [m]
  std::vector<float> variance_m2;                   ///< of the residual, without the kernel's share

  /// Rows that were added; the columns are longer, and keep their memory when cleared.
  std::size_t count = 0;

  void clear(const Eigen::Vector3d& new_centre) {
    centre = new_centre;
    count = 0;
  }
  void add(const Eigen::Vector3f& point_lidar, const Eigen::Vector3f& normal, float row_offset,
           float row_variance_m2) {
    if (count == offset.size()) grow(2 * count + kMostLanes);
    set(count++, point_lidar, normal, row_offset, row_variance_m2);
  }
  /// Fills the columns up with rows that add nothing to any sum, so that whole vectors can be read.
  /// To be called once after the last `add`.
  void pad();

 private:
  void grow(std::size_t rows);
  void set(std::size_t row, const Eigen::Vector3f& point_lidar, const Eigen::Vector3f& normal,
           float row_offset, float row_variance_m2) {
    point_x[row] = point_lidar.x();
    point_y[row] = point_lidar.y();
    point_z[row] = point_lidar.z();
    normal_x[row] = normal.x();
    normal_y[row] = normal.y();
    normal_z[row] = normal.z();
    offset[row] = row_offset;
    variance_m2[row] = row_variance_m2;
  }
};

/// Distance of one point to a surface along an axis of it, and its derivative.
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
/// The same of a row.
[[nodiscard]] AxisResidual axis_residual(const ResidualRows& rows, std::size_t row,
                                         const Eigen::Isometry3d& T_index_lidar);

/// Weight of a residual (Geman-McClure): derivative of half of k^2 r^2 / (k^2 + r^2) by r^2 / 2, in
/// (0, 1].
template <typename Scalar>
[[nodiscard]] constexpr Scalar robust_weight(Scalar residual2_m2, Scalar kernel_m) {
  const Scalar share = kernel_m * kernel_m / (kernel_m * kernel_m + residual2_m2);
  return share * share;
}

/// What the width of the kernel adds to a row's variance [m^2]: while it is wide nothing is known
/// to better.
template <typename Scalar>
[[nodiscard]] constexpr Scalar kernel_variance_m2(Scalar kernel_m) {
  return kernel_m * kernel_m / Scalar{9};
}

/// Sums of all rows at a pose, each weighted by robust_weight / (variance + kernel's share).
/// Vectorised for the machine it runs on; the sums of two instruction sets differ in the last
/// bits of a float.
[[nodiscard]] NormalEquations linearize(const ResidualRows& rows,
                                        const Eigen::Isometry3d& T_index_lidar, float kernel_m);

}  // namespace stillmap::localization
