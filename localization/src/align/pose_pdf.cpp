#include "pose_pdf.hpp"

#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/small_matrices.hpp>

#include <mrpt/poses/CPose3D.h>
#include <mrpt/poses/Lie/SE.h>

#include <cmath>

namespace stillmap::localization {
namespace {

/// Adjoint of T_b_c^-1: turns a perturbation of T_a_b on the right into one of T_a_b T_b_c.
Matrix6d adjoint_of_inverse(const Eigen::Isometry3d& T_b_c) {
  const mrpt::poses::CPose3D pose(mrpt::math::CMatrixDouble44(Eigen::Matrix4d(T_b_c.matrix())));
  // d log(T_b_c^-1 exp(-e) T_b_c) / de at 0: the logarithm is taken at the identity, never near pi.
  mrpt::math::CMatrixDouble66 derivative;
  mrpt::poses::Lie::SE<3>::jacob_dDinvP1invP2_de1e2(-pose, mrpt::poses::CPose3D(), pose,
                                                    derivative);
  return -derivative.asEigen();
}

}  // namespace

PosePdf composed(const PosePdf& T_a_b, const PosePdf& T_b_c) {
  const Matrix6d adjoint = adjoint_of_inverse(T_b_c.T);
  const Matrix6d covariance = adjoint * T_a_b.covariance * adjoint.transpose() + T_b_c.covariance;
  return {maps::renormalized(T_a_b.T * T_b_c.T), 0.5 * (covariance + covariance.transpose())};
}

PosePdf fused(const PosePdf& a, const PosePdf& b) {
  // MRPT's bayesianFusion throws "TO DO" for 3D poses.
  const Vector6d apart = maps::log_se3(a.T.inverse() * b.T);
  const Matrix6d gain = maps::ldlt_solve(a.covariance + b.covariance, a.covariance).transpose();
  const Matrix6d covariance = a.covariance - gain * a.covariance;
  return {maps::renormalized(a.T * maps::exp_se3(gain * apart)),
          0.5 * (covariance + covariance.transpose())};
}

double chi_squared(const PosePdf& a, const PosePdf& b) {
  const Vector6d difference = maps::log_se3(a.T.inverse() * b.T);
  const Matrix6d sum = a.covariance + b.covariance;
  // Eigen's factorization takes NaN for a pivot of zero and answers 0.
  if (!sum.allFinite() || !difference.allFinite()) return std::nan("");
  const double squares = difference.dot(maps::ldlt_solve(sum, difference));
  return squares >= 0.0 ? squares : std::nan("");
}

}  // namespace stillmap::localization
