#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/small_matrices.hpp>

#include <algorithm>
#include <cmath>

namespace stillmap::maps {
namespace {

// Below this angle the closed forms lose more digits than four terms of their series do.
constexpr double kSeriesBelowRad = 0.05;

Eigen::Matrix3d skew(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return m;
}

/// (1 - cos a) / a^2, written with the half angle so that nothing cancels.
double one_minus_cos_over_square(double a) {
  const double half = 0.5 * a;
  const double sinc = half < 1e-8 ? 1.0 : std::sin(half) / half;
  return 0.5 * sinc * sinc;
}

/// (a - sin a) / a^3.
double a_minus_sin_over_cube(double a) {
  if (a >= kSeriesBelowRad) return (a - std::sin(a)) / (a * a * a);
  const double s = a * a;
  return 1.0 / 6.0 - s * (1.0 / 120.0 - s * (1.0 / 5040.0 - s / 362880.0));
}

/// (1 - a/2 cot(a/2)) / a^2; finite up to pi, where the usual form divides by sin(pi).
double inverse_coupling(double a) {
  if (a >= kSeriesBelowRad) return (1.0 - 0.5 * a / std::tan(0.5 * a)) / (a * a);
  const double s = a * a;
  return 1.0 / 12.0 + s * (1.0 / 720.0 + s * (1.0 / 30240.0 + s / 1209600.0));
}

/// Through the quaternion: its vector part still tells the axis at pi, where R - R^T has vanished.
Eigen::AngleAxisd angle_axis_of(const Eigen::Matrix3d& R) {
  return Eigen::AngleAxisd(Eigen::Quaterniond(R).normalized());
}

}  // namespace

Eigen::Isometry3d renormalized(const Eigen::Isometry3d& T) {
  // The nearest rotation in the Frobenius norm; a quaternion would favour some of the nine numbers.
  const SingularValues svd = svd_of(T.linear());
  Eigen::Matrix3d U = svd.U;
  if (U.determinant() * svd.V.determinant() < 0.0) U.col(2) = -U.col(2);
  Eigen::Isometry3d result = T;
  result.linear() = U * svd.V.transpose();
  return result;
}

Eigen::Isometry3d exp_se3(const Eigen::Matrix<double, 6, 1>& twist) {
  const Eigen::Vector3d rotation = twist.tail<3>();
  const double angle = rotation.norm();
  const Eigen::Matrix3d W = skew(rotation);
  const Eigen::Matrix3d W2 = W * W;
  const double a = one_minus_cos_over_square(angle);
  const Eigen::Matrix3d V = Eigen::Matrix3d::Identity() + a * W + a_minus_sin_over_cube(angle) * W2;
  const double sinc = 1.0 - angle * angle * a_minus_sin_over_cube(angle);
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::Matrix3d::Identity() + sinc * W + a * W2;
  T.translation() = V * twist.head<3>();
  return T;
}

Eigen::Matrix3d exp_so3(const Eigen::Vector3d& rotation) {
  const double angle = rotation.norm();
  const Eigen::Matrix3d W = skew(rotation);
  const double sinc = 1.0 - angle * angle * a_minus_sin_over_cube(angle);
  return Eigen::Matrix3d::Identity() + sinc * W + one_minus_cos_over_square(angle) * W * W;
}

Eigen::Vector3d log_so3(const Eigen::Matrix3d& R) {
  const Eigen::AngleAxisd angle_axis = angle_axis_of(R);
  return angle_axis.angle() * angle_axis.axis();
}

Eigen::Matrix<double, 6, 1> log_se3(const Eigen::Isometry3d& T) {
  const Eigen::AngleAxisd angle_axis = angle_axis_of(T.linear());
  const Eigen::Vector3d rotation = angle_axis.angle() * angle_axis.axis();
  const Eigen::Matrix3d W = skew(rotation);
  const Eigen::Matrix3d V_inverse =
      Eigen::Matrix3d::Identity() - 0.5 * W + inverse_coupling(angle_axis.angle()) * W * W;
  Eigen::Matrix<double, 6, 1> twist;
  twist << V_inverse * T.translation(), rotation;
  return twist;
}

Eigen::Vector3d roll_pitch_yaw_rad(const Eigen::Matrix3d& R) {
  return {std::atan2(R(2, 1), R(2, 2)), -std::asin(std::clamp(R(2, 0), -1.0, 1.0)),
          std::atan2(R(1, 0), R(0, 0))};
}

double rotation_angle_rad(const Eigen::Matrix3d& R) {
  const Eigen::Vector3d axis(R(2, 1) - R(1, 2), R(0, 2) - R(2, 0), R(1, 0) - R(0, 1));
  return std::atan2(axis.norm(), R.trace() - 1.0);
}

}  // namespace stillmap::maps
