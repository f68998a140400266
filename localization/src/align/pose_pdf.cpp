#include "pose_pdf.hpp"

#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/small_matrices.hpp>

#include <mrpt/poses/CPose3DPDFGaussian.h>

#include <algorithm>
#include <cmath>

namespace stillmap::localization {
namespace {

/// MRPT's coordinates of a pose are x y z yaw pitch roll, which break down at a pitch of 90
/// degrees; a lidar may be mounted so. Poses are therefore given to it relative to one nearby, and
/// turns beyond this in several steps [rad].
constexpr double kMaxTurnRad = 0.8;

mrpt::poses::CPose3D to_mrpt(const Eigen::Isometry3d& T) {
  return mrpt::poses::CPose3D(mrpt::math::CMatrixDouble44(Eigen::Matrix4d(T.matrix())));
}

/// Derivative of yaw, pitch, roll at R exp(r) by r, put into the whole of a pose's coordinates.
Matrix6d coordinates_by_perturbation(const mrpt::poses::CPose3D& pose, const Eigen::Matrix3d& R) {
  const double pitch = pose.pitch();
  const double roll = pose.roll();
  // Rates of roll, pitch, yaw (in this order) by those about the body's axes.
  Eigen::Matrix3d rates;
  rates << 1.0, std::sin(roll) * std::tan(pitch), std::cos(roll) * std::tan(pitch),  //
      0.0, std::cos(roll), -std::sin(roll),                                          //
      0.0, std::sin(roll) / std::cos(pitch), std::cos(roll) / std::cos(pitch);
  Matrix6d jacobian = Matrix6d::Zero();
  jacobian.topLeftCorner<3, 3>() = R;
  jacobian.bottomRightCorner<3, 3>() = rates.colwise().reverse();
  return jacobian;
}

mrpt::poses::CPose3DPDFGaussian to_mrpt(const PosePdf& pdf) {
  const mrpt::poses::CPose3D mean = to_mrpt(pdf.T);
  const Matrix6d jacobian = coordinates_by_perturbation(mean, pdf.T.linear());
  return {mean,
          mrpt::math::CMatrixDouble66(Matrix6d(jacobian * pdf.covariance * jacobian.transpose()))};
}

PosePdf from_mrpt(const mrpt::poses::CPose3DPDFGaussian& gaussian) {
  PosePdf pdf;
  pdf.T.matrix() = gaussian.mean.getHomogeneousMatrixVal<mrpt::math::CMatrixDouble44>().asEigen();
  const Matrix6d inverse = coordinates_by_perturbation(gaussian.mean, pdf.T.linear()).inverse();
  const Matrix6d covariance = inverse * gaussian.cov.asEigen() * inverse.transpose();
  pdf.covariance = 0.5 * (covariance + covariance.transpose());
  return pdf;
}

}  // namespace

PosePdf composed(const PosePdf& T_a_b, const PosePdf& T_b_c) {
  const Vector6d twist = maps::log_se3(T_b_c.T);
  const int steps = std::max(1, static_cast<int>(std::ceil(twist.tail<3>().norm() / kMaxTurnRad)));
  PosePdf step{maps::exp_se3(twist / steps), Matrix6d::Zero()};
  PosePdf here{Eigen::Isometry3d::Identity(), T_a_b.covariance};
  for (int done = 1; done <= steps; ++done) {
    if (done == steps) step.covariance = T_b_c.covariance;
    mrpt::poses::CPose3DPDFGaussian gaussian = to_mrpt(here);
    gaussian += to_mrpt(step);
    here.covariance = from_mrpt(gaussian).covariance;
  }
  return {maps::renormalized(T_a_b.T * T_b_c.T), here.covariance};
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
