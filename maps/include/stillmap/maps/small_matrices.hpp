#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <optional>

/// Decompositions of small matrices, by Eigen and compiled once: in each file that asks Eigen for
/// one, the compiler spends seconds on it.
namespace stillmap::maps {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector12d = Eigen::Matrix<double, 12, 1>;
using Matrix12d = Eigen::Matrix<double, 12, 12>;

/// M = vectors * diag(values) * vectors^T.
template <int N>
struct SymmetricEigen {
  /// Ascending.
  Eigen::Matrix<double, N, 1> values;
  /// Orthonormal columns, in the order of `values`.
  Eigen::Matrix<double, N, N> vectors;
};

/// Of a symmetric matrix, whose lower triangle is read (Eigen::SelfAdjointEigenSolver).
[[nodiscard]] SymmetricEigen<3> eigen_of(const Eigen::Matrix3d& symmetric);
[[nodiscard]] SymmetricEigen<6> eigen_of(const Matrix6d& symmetric);
[[nodiscard]] SymmetricEigen<12> eigen_of(const Matrix12d& symmetric);

/// By closed formulas: fast, with errors of the order of 1e-8 of the largest value
/// (Eigen::SelfAdjointEigenSolver::computeDirect).
[[nodiscard]] SymmetricEigen<3> eigen_directly_of(const Eigen::Matrix3d& symmetric);

/// M = U * diag(values) * V^T.
struct SingularValues {
  Eigen::Matrix3d U;
  /// Descending.
  Eigen::Vector3d values;
  Eigen::Matrix3d V;
};

/// Of any 3 x 3 matrix (Eigen::JacobiSVD).
[[nodiscard]] SingularValues svd_of(const Eigen::Matrix3d& matrix);

/// A^-1 b for a symmetric A that need not be definite (Eigen::LDLT). A direction in which A is zero
/// is answered by 0, and so is NaN.
[[nodiscard]] Eigen::Vector3d ldlt_solve(const Eigen::Matrix3d& A, const Eigen::Vector3d& b);
[[nodiscard]] Vector6d ldlt_solve(const Matrix6d& A, const Vector6d& b);
[[nodiscard]] Matrix6d ldlt_solve(const Matrix6d& A, const Matrix6d& B);
[[nodiscard]] Vector12d ldlt_solve(const Matrix12d& A, const Vector12d& b);

/// The lower triangle L of A = L L^T (Eigen::LLT); nothing where A is not positive definite. NaN
/// may pass, and is then in L.
[[nodiscard]] std::optional<Eigen::Matrix3d> cholesky(const Eigen::Matrix3d& A);
[[nodiscard]] std::optional<Matrix6d> cholesky(const Matrix6d& A);

/// L^-1 of A = L L^T, for a positive definite A: W of A^-1 = W^T W.
[[nodiscard]] Eigen::Matrix3d inverse_cholesky(const Eigen::Matrix3d& A);
[[nodiscard]] Matrix6d inverse_cholesky(const Matrix6d& A);

/// A^-1 of a positive definite matrix.
[[nodiscard]] Matrix6d inverse_of(const Matrix6d& A);

/// x^T A^-1 x: what chi squared tests are asked about. Nothing where A is not positive definite.
[[nodiscard]] std::optional<double> mahalanobis_squared(const Vector6d& x, const Matrix6d& A);

/// The shortest turn that takes the direction of `from` to that of `to`; any lengths above 0.
[[nodiscard]] Eigen::Quaterniond turn_between(const Eigen::Vector3d& from,
                                              const Eigen::Vector3d& to);

}  // namespace stillmap::maps
