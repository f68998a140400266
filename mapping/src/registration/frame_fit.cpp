#include "registration/frame_fit.hpp"

#include <stillmap/localization/adjoint.hpp>

#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/small_matrices.hpp>

#include <algorithm>
#include <cmath>

namespace stillmap::mapping {
namespace {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

/// Errors of poses that belong together, as of a survey or of odometry within a few metres.
constexpr double kPoseSigmaM = 0.01;
constexpr double kPoseSigmaRad = 0.0005;
constexpr double kFirstKernel = 100.0;
constexpr double kLastKernel = 3.0;
constexpr int kSteps = 5;

/// By which the motion misses a sight, in the lidar frame.
Vector6d miss_of(const FrameSight& sight, const Eigen::Isometry3d& T_map_own) {
  return maps::log_se3(sight.T_map_lidar.inverse() * T_map_own * sight.T_own_lidar);
}

bool agree(const Vector6d& miss, const FrameTolerance& tolerance) {
  return miss.head<3>().norm() <= tolerance.translation_m &&
         miss.tail<3>().norm() <= tolerance.rotation_rad;
}

Matrix6d information_of(const FrameSight& sight) {
  Matrix6d covariance = sight.covariance;
  covariance.diagonal().head<3>().array() += kPoseSigmaM * kPoseSigmaM;
  covariance.diagonal().tail<3>().array() += kPoseSigmaRad * kPoseSigmaRad;
  return maps::inverse_of(covariance);
}

/// The sights around the middle of their positions, so that a turn far from the origin of either
/// frame does not drown the shift.
std::vector<FrameSight> centred(std::span<const FrameSight> sights,
                                const Eigen::Vector3d& middle_own) {
  std::vector<FrameSight> moved(sights.begin(), sights.end());
  for (FrameSight& sight : moved) sight.T_own_lidar.pretranslate(-middle_own);
  return moved;
}

Vector6d step_of(std::span<const FrameSight> sights, const std::vector<Matrix6d>& information,
                 const Eigen::Isometry3d& T_map_middle, double kernel) {
  Matrix6d H = Matrix6d::Zero();
  Vector6d g = Vector6d::Zero();
  for (std::size_t i = 0; i < sights.size(); ++i) {
    const Vector6d miss = miss_of(sights[i], T_map_middle);
    const Matrix6d J = localization::adjoint(sights[i].T_own_lidar.inverse());
    const double share = kernel * kernel / (kernel * kernel + miss.dot(information[i] * miss));
    const Matrix6d weighted = share * share * J.transpose() * information[i];
    H += weighted * J;
    g += weighted * miss;
  }
  return -maps::ldlt_solve(H, g);
}

void judge(std::span<const FrameSight> sights, const FrameTolerance& tolerance, FrameFit& fit) {
  double sum2_m = 0.0, sum2_rad = 0.0;
  for (const FrameSight& sight : sights) {
    const Vector6d miss = miss_of(sight, fit.T_map_own);
    fit.agrees.push_back(agree(miss, tolerance) ? 1 : 0);
    if (fit.agrees.back() == 0) continue;
    ++fit.agreeing;
    sum2_m += miss.head<3>().squaredNorm();
    sum2_rad += miss.tail<3>().squaredNorm();
  }
  const double count = static_cast<double>(std::max<std::size_t>(1, fit.agreeing));
  fit.residual_m = std::sqrt(sum2_m / count);
  fit.residual_rad = std::sqrt(sum2_rad / count);
}

}  // namespace

std::optional<Eigen::Isometry3d> most_agreed(std::span<const FrameSight> sights,
                                             const FrameTolerance& tolerance, std::size_t least) {
  std::optional<Eigen::Isometry3d> best;
  std::size_t most = 0;
  for (const FrameSight& candidate : sights) {
    const Eigen::Isometry3d T_map_own = candidate.T_map_lidar * candidate.T_own_lidar.inverse();
    const auto votes = static_cast<std::size_t>(std::count_if(
        sights.begin(), sights.end(),
        [&](const FrameSight& sight) { return agree(miss_of(sight, T_map_own), tolerance); }));
    if (votes <= most) continue;
    most = votes;
    best = T_map_own;
  }
  if (most < least || 2 * most <= sights.size()) return std::nullopt;
  return best;
}

FrameFit fit_frames(std::span<const FrameSight> sights, const Eigen::Isometry3d& start,
                    const FrameTolerance& tolerance) {
  FrameFit fit;
  fit.T_map_own = start;
  if (sights.empty()) return fit;
  Eigen::Vector3d middle_own = Eigen::Vector3d::Zero();
  for (const FrameSight& sight : sights) middle_own += sight.T_own_lidar.translation();
  middle_own /= static_cast<double>(sights.size());
  const std::vector<FrameSight> around = centred(sights, middle_own);
  std::vector<Matrix6d> information;
  for (const FrameSight& sight : around) information.push_back(information_of(sight));
  Eigen::Isometry3d T_map_middle = start * Eigen::Translation3d(middle_own);
  for (double kernel = kFirstKernel;; kernel = std::max(kLastKernel, 0.5 * kernel)) {
    for (int step = 0; step < kSteps; ++step)
      T_map_middle = maps::renormalized(
          T_map_middle * maps::exp_se3(step_of(around, information, T_map_middle, kernel)));
    if (kernel == kLastKernel) break;
  }
  fit.T_map_own = maps::renormalized(T_map_middle * Eigen::Translation3d(-middle_own));
  judge(sights, tolerance, fit);
  return fit;
}

}  // namespace stillmap::mapping
