#include "calibration/hand_eye.hpp"

#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/median.hpp>

#include <algorithm>
#include <cmath>

namespace stillmap::mapping {
namespace {

using maps::Matrix6d;
using maps::Vector6d;

/// Errors of odometry over one motion, for the weights; their common scale is measured.
constexpr double kMotionSigmaM = 0.03;
constexpr double kMotionSigmaRad = 0.002;
constexpr std::size_t kLeastMotions = 6;
/// A motion that turns less is a way whose direction tells the rotation.
constexpr double kStraightRad = 0.03;
constexpr double kLeastWayM = 1.0;
/// Ways bend and are longer than turns are wide [m / rad].
constexpr double kWayWeightPerM = 0.1;
constexpr int kRounds = 30;
/// Geman-McClure, in deviations.
constexpr double kKernel = 3.0;
constexpr double kStepRad = 1e-6;

/// In units of the deviations.
Vector6d residual_of(const MotionPair& motion, const Eigen::Isometry3d& X) {
  Vector6d e = maps::log_se3(motion.T_lidar.inverse() * X.inverse() * motion.T_reference * X);
  e.head<3>() /= kMotionSigmaM;
  e.tail<3>() /= kMotionSigmaRad;
  return e;
}

Matrix6d jacobian_of(const MotionPair& motion, const Eigen::Isometry3d& X) {
  Matrix6d J;
  for (Eigen::Index k = 0; k < 6; ++k) {
    const Vector6d step = kStepRad * Vector6d::Unit(k);
    J.col(k) = (residual_of(motion, changed_mount(X, step)) -
                residual_of(motion, changed_mount(X, -step))) /
               (2.0 * kStepRad);
  }
  return J;
}

/// The rotation that turns directions of one sensor to those of the other: turns by their axes,
/// straight ways by their directions.
/// @see Kabsch, "A solution for the best rotation to relate two sets of vectors", 1976.
std::optional<Eigen::Matrix3d> rotation_of(std::span<const MotionPair> motions) {
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  for (const MotionPair& motion : motions) {
    const Eigen::Vector3d a = maps::log_so3(motion.T_reference.linear());
    const Eigen::Vector3d b = maps::log_so3(motion.T_lidar.linear());
    sum += a * b.transpose();
    if (std::max(a.norm(), b.norm()) > kStraightRad ||
        motion.T_reference.translation().norm() < kLeastWayM)
      continue;
    sum += kWayWeightPerM * kWayWeightPerM * motion.T_reference.translation() *
           motion.T_lidar.translation().transpose();
  }
  const maps::SingularValues svd = maps::svd_of(sum);
  // One direction alone leaves the turn about it open.
  if (!(svd.values[1] > 1e-4)) return std::nullopt;
  Eigen::Vector3d signs = Eigen::Vector3d::Ones();
  signs.z() = (svd.U * svd.V.transpose()).determinant() < 0.0 ? -1.0 : 1.0;
  return Eigen::Matrix3d(svd.U * signs.asDiagonal() * svd.V.transpose());
}

/// The shift that belongs to a rotation: (R_a - I) t = R t_b - t_a, with little weight on zero.
Eigen::Vector3d translation_of(std::span<const MotionPair> motions, const Eigen::Matrix3d& R) {
  Eigen::Matrix3d H = Eigen::Matrix3d::Identity() / (kUnknownMountM * kUnknownMountM);
  Eigen::Vector3d g = Eigen::Vector3d::Zero();
  constexpr double kWeight = 1.0 / (kMotionSigmaM * kMotionSigmaM);
  for (const MotionPair& motion : motions) {
    const Eigen::Matrix3d A = motion.T_reference.linear() - Eigen::Matrix3d::Identity();
    H += kWeight * A.transpose() * A;
    g += kWeight * A.transpose() *
         (R * motion.T_lidar.translation() - motion.T_reference.translation());
  }
  return maps::ldlt_solve(H, g);
}

struct NormalEquations {
  Matrix6d H = Matrix6d::Zero();
  Vector6d g = Vector6d::Zero();
};

/// @param scale2  square of how much larger the motions' errors are than the constants.
NormalEquations normal_equations(std::span<const MotionPair> motions, const Eigen::Isometry3d& X,
                                 double scale2) {
  NormalEquations sums;
  for (const MotionPair& motion : motions) {
    const Vector6d e = residual_of(motion, X);
    const Matrix6d J = jacobian_of(motion, X);
    const double share = kKernel * kKernel / (kKernel * kKernel + e.squaredNorm() / (6.0 * scale2));
    sums.H += share * share * J.transpose() * J;
    sums.g += share * share * J.transpose() * e;
  }
  sums.H /= scale2;
  sums.g /= scale2;
  return sums;
}

/// Median of the squared residuals, a degree of freedom.
double scale2_of(std::span<const MotionPair> motions, const Eigen::Isometry3d& X) {
  /// Of chi squared with 6 degrees of freedom.
  constexpr double kMedian = 5.348;
  /// No odometry is a hundred times as exact; less would make rounding errors count.
  constexpr double kExact = 1e-4;
  std::vector<double> squares;
  for (const MotionPair& motion : motions)
    squares.push_back(residual_of(motion, X).squaredNorm() / kMedian);
  return std::max(maps::median(std::move(squares)), kExact);
}

}  // namespace

Matrix6d unknown_mount_covariance() {
  Vector6d variances;
  variances.head<3>().setConstant(kUnknownMountM * kUnknownMountM);
  variances.tail<3>().setConstant(kUnknownMountRad * kUnknownMountRad);
  return variances.asDiagonal();
}

Vector6d difference_of_mounts(const Eigen::Isometry3d& T_reference_lidar,
                              const Eigen::Isometry3d& from) {
  Vector6d difference;
  difference.head<3>() = T_reference_lidar.translation() - from.translation();
  difference.tail<3>() = maps::log_so3(T_reference_lidar.linear() * from.linear().transpose());
  return difference;
}

Eigen::Isometry3d changed_mount(const Eigen::Isometry3d& T_reference_lidar, const Vector6d& by) {
  Eigen::Isometry3d changed = T_reference_lidar;
  changed.translation() += by.head<3>();
  changed.linear() = maps::exp_so3(by.tail<3>()) * T_reference_lidar.linear();
  return changed;
}

std::optional<MountEstimate> fit_hand_eye(std::span<const MotionPair> motions) {
  if (motions.size() < kLeastMotions) return std::nullopt;
  const std::optional<Eigen::Matrix3d> R = rotation_of(motions);
  if (!R) return std::nullopt;
  MountEstimate estimate;
  Eigen::Isometry3d& X = estimate.T_reference_lidar;
  X.linear() = *R;
  X.translation() = translation_of(motions, *R);
  const Matrix6d prior = maps::inverse_of(unknown_mount_covariance());
  for (int round = 0; round < kRounds; ++round) {
    NormalEquations sums = normal_equations(motions, X, scale2_of(motions, X));
    // Of the shift alone: a rotation far from none is no less likely.
    sums.g.head<3>() += prior.topLeftCorner<3, 3>() * X.translation();
    const Vector6d step = -maps::ldlt_solve(Matrix6d(sums.H + prior), sums.g);
    X = maps::renormalized(changed_mount(X, step));
    if (step.norm() < 1e-10) break;
  }
  estimate.covariance =
      maps::inverse_of(normal_equations(motions, X, scale2_of(motions, X)).H + prior);
  return estimate;
}

Matrix6d jackknife_covariance(std::span<const Vector6d> without) {
  Vector6d mean = Vector6d::Zero();
  for (const Vector6d& each : without) mean += each / static_cast<double>(without.size());
  Matrix6d covariance = Matrix6d::Zero();
  for (const Vector6d& each : without) covariance += (each - mean) * (each - mean).transpose();
  const auto count = static_cast<double>(without.size());
  return covariance * (count - 1.0) / count;
}

std::optional<MountEstimate> fit_hand_eye_in_blocks(std::span<const MotionPair> motions,
                                                    std::span<const std::size_t> blocks) {
  std::optional<MountEstimate> all = fit_hand_eye(motions);
  if (!all) return all;
  const std::size_t count = *std::ranges::max_element(blocks) + 1;
  std::vector<Vector6d> without;
  for (std::size_t block = 0; block < count; ++block) {
    std::vector<MotionPair> others;
    for (std::size_t i = 0; i < motions.size(); ++i)
      if (blocks[i] != block) others.push_back(motions[i]);
    const auto fit = fit_hand_eye(others);
    if (!fit) return MountEstimate{all->T_reference_lidar, unknown_mount_covariance()};
    without.push_back(difference_of_mounts(fit->T_reference_lidar, all->T_reference_lidar));
  }
  if (without.size() > 1) all->covariance += jackknife_covariance(without);
  return all;
}

}  // namespace stillmap::mapping
