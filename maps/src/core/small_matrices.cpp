#include <stillmap/maps/small_matrices.hpp>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/SVD>

#include <cmath>

namespace stillmap::maps {
namespace {

/// 1 less the cosine: up to 1.4 microradians from opposite, any axis across will do.
constexpr double kOpposite = 1e-12;

template <int N>
SymmetricEigen<N> solved_eigen(const Eigen::Matrix<double, N, N>& symmetric) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, N, N>> solver(symmetric);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

template <typename Matrix>
std::optional<Matrix> lower_factor(const Matrix& A) {
  const Eigen::LLT<Matrix> factor(A);
  if (factor.info() != Eigen::Success) return std::nullopt;
  return Matrix(factor.matrixL());
}

template <typename Matrix>
Matrix inverse_of_factor(const Matrix& A) {
  return Eigen::LLT<Matrix>(A).matrixL().solve(Matrix::Identity());
}

}  // namespace

SymmetricEigen<3> eigen_of(const Eigen::Matrix3d& symmetric) { return solved_eigen<3>(symmetric); }
SymmetricEigen<6> eigen_of(const Matrix6d& symmetric) { return solved_eigen<6>(symmetric); }
SymmetricEigen<12> eigen_of(const Matrix12d& symmetric) { return solved_eigen<12>(symmetric); }

SymmetricEigen<3> eigen_directly_of(const Eigen::Matrix3d& symmetric) {
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
  solver.computeDirect(symmetric);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

SingularValues svd_of(const Eigen::Matrix3d& matrix) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(matrix, Eigen::ComputeFullU | Eigen::ComputeFullV);
  return {svd.matrixU(), svd.singularValues(), svd.matrixV()};
}

Eigen::Vector3d ldlt_solve(const Eigen::Matrix3d& A, const Eigen::Vector3d& b) {
  return A.ldlt().solve(b);
}
Vector6d ldlt_solve(const Matrix6d& A, const Vector6d& b) { return A.ldlt().solve(b); }
Matrix6d ldlt_solve(const Matrix6d& A, const Matrix6d& B) { return A.ldlt().solve(B); }
Vector12d ldlt_solve(const Matrix12d& A, const Vector12d& b) { return A.ldlt().solve(b); }

std::optional<Eigen::Matrix3d> cholesky(const Eigen::Matrix3d& A) { return lower_factor(A); }
std::optional<Matrix6d> cholesky(const Matrix6d& A) { return lower_factor(A); }

Eigen::Matrix3d inverse_cholesky(const Eigen::Matrix3d& A) { return inverse_of_factor(A); }
Matrix6d inverse_cholesky(const Matrix6d& A) { return inverse_of_factor(A); }

Matrix6d inverse_of(const Matrix6d& A) { return A.llt().solve(Matrix6d::Identity()); }

std::optional<double> mahalanobis_squared(const Vector6d& x, const Matrix6d& A) {
  const Eigen::LLT<Matrix6d> factor(A);
  if (factor.info() != Eigen::Success) return std::nullopt;
  return x.dot(factor.solve(x));
}

// As Eigen::Quaterniond::FromTwoVectors, which asks a singular value decomposition for an axis
// where the two are opposite; that alone takes the compiler 10 s.
Eigen::Quaterniond turn_between(const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  const Eigen::Vector3d a = from.normalized(), b = to.normalized();
  const double cosine = b.dot(a);
  Eigen::Quaterniond turn;
  if (cosine < -1.0 + kOpposite) {
    turn.vec() = a.unitOrthogonal();
    turn.w() = 0.0;
    return turn;
  }
  const double s = std::sqrt((1.0 + cosine) * 2.0);
  turn.vec() = a.cross(b) * (1.0 / s);
  turn.w() = s * 0.5;
  return turn;
}

}  // namespace stillmap::maps
