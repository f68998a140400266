#pragma once

#include <stillmap/maps/small_matrices.hpp>

#include "index/voxel_table.hpp"
#include "registration.hpp"
#include "residual_rows.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <cstdint>
#include <vector>

namespace stillmap::localization {

/// Root mean square thickness of the surfaces of a map with exact poses: noise of the sensor, and
/// what half a metre of a wall is not flat. Simulated maps have 2.1 to 3.1 cm, real ones 3.9 to
/// 4.4 cm. What is beyond it is the map's own disagreement.
inline constexpr double kUsualThicknessM = 0.032;

/// Points within a block of this edge share their error [m], and blocks still share some with their
/// neighbours: so many times the variance of independent ones.
inline constexpr double kErrorBlockM = 4.0;
inline constexpr double kNeighbourFactor = 2.4;
[[nodiscard]] inline std::uint64_t error_block(const Eigen::Vector3d& at_m) {
  const Eigen::Array3i cell = (at_m / kErrorBlockM).array().floor().cast<int>() + 1024;
  return cell_key(cell.x(), cell.y(), cell.z());
}

/// Inverse of a symmetric matrix with its smallest eigenvalues raised, so that a direction which
/// nothing constrains does not divide by zero.
template <int N>
[[nodiscard]] Eigen::Matrix<double, N, N> bounded_inverse(
    const Eigen::Matrix<double, N, N>& matrix) {
  const maps::SymmetricEigen<N> eigen = maps::eigen_of(matrix);
  const Eigen::Matrix<double, N, 1> values = eigen.values.cwiseMax(1e-6 * eigen.values[N - 1]);
  return eigen.vectors * values.cwiseInverse().asDiagonal() * eigen.vectors.transpose();
}

/// Sums of residuals with N unknowns, and what they tell about the error of those: errors that
/// neighbours share (a voxel's mean, a bent wall, a car that moved) count once, H^-1 (sum_b g_b
/// g_b^T) H^-1 over blocks of space (Huber's sandwich, clustered), and more where the map's
/// surfaces are thicker than a map's with exact poses. Its factors are calibrated on simulated
/// drives (localization/how_it_works.md).
template <int N>
class ClusteredSums {
 public:
  using Vector = Eigen::Matrix<double, N, 1>;
  using Matrix = Eigen::Matrix<double, N, N>;

  explicit ClusteredSums(double kernel_m) : kernel_m_(kernel_m) {}

  /// @param at_m  of the point, in the map. @param J  derivative of the residual.
  void add(const Eigen::Vector3d& at_m, double residual_m, double variance_m2, const Vector& J) {
    const auto [block, inserted] = blocks_.insert(error_block(at_m));
    if (inserted) sums_.emplace_back(Vector::Zero());
    const double robust = robust_weight(residual_m * residual_m, kernel_m_);
    const double weight = robust / (variance_m2 + kernel_variance_m2(kernel_m_));
    sums_[block] += weight * residual_m * J;
    const Matrix outer = J * J.transpose();
    H_ += weight * outer;
    geometry_ += robust * outer;
    robust_sum_ += robust;
    thickness_sum_ += robust * variance_m2;
  }

  /// Whether any residual counts.
  [[nodiscard]] bool any() const { return robust_sum_ > 0.0; }
  [[nodiscard]] const Matrix& H() const { return H_; }

  /// @param units  of the unknowns in which their eigenvalues compare; the result is in these.
  /// @param known  of each unknown before, as one over its variance, in its own unit.
  [[nodiscard]] Matrix covariance(const Vector& units, const Vector& known = Vector::Zero()) const {
    const auto in_units = [&](const Matrix& matrix) -> Matrix {
      return units.asDiagonal() * matrix * units.asDiagonal();
    };
    const Matrix own = known.asDiagonal();
    Matrix spread = Matrix::Zero();
    for (const Vector& sum : sums_) spread += sum * sum.transpose();
    const Matrix inverse = bounded_inverse<N>(in_units(H_ + own));
    const double disagreement_m2 =
        std::max(0.0, thickness_sum_ / robust_sum_ - kUsualThicknessM * kUsualThicknessM);
    const double shared_m2 = disagreement_m2 / kIndependentSurfaces;
    Matrix covariance = kNeighbourFactor * inverse * in_units(spread + own) * inverse;
    covariance +=
        shared_m2 * bounded_inverse<N>(in_units(geometry_ / robust_sum_ + shared_m2 * own));
    return covariance;
  }

 private:
  /// What is beyond `kUsualThicknessM` no number of points averages out: a scan is worth so many
  /// independent surfaces then.
  static constexpr double kIndependentSurfaces = 60.0;

  double kernel_m_;
  VoxelTable blocks_;
  std::vector<Vector> sums_;
  Matrix H_ = Matrix::Zero();
  Matrix geometry_ = Matrix::Zero();
  double robust_sum_ = 0.0;
  double thickness_sum_ = 0.0;
};

}  // namespace stillmap::localization
