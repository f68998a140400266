#include "trajectory/path_difference.hpp"

#include "trajectory/lag_search.hpp"
#include "trajectory/path_motions.hpp"

#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/median.hpp>
#include <stillmap/maps/small_matrices.hpp>

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Poses are smoothed over so long, or so many steps of the slower path.
constexpr double kLeastBoxS = 0.5;
constexpr double kBoxSteps = 4.0;
constexpr double kFewestIndependent = 3.0;
/// Least deviations of one direction of a motion: odometry's own [m, rad].
constexpr double kLeastLeftM = 0.005;
constexpr double kLeastLeftRad = 3e-4;
/// A residual of so many deviations has half its weight.
constexpr double kRobust = 3.0;
/// So many deviations in all directions are no noise.
constexpr double kOutlierDeviations = 5.0;
constexpr int kFitRounds = 100;
/// A fit whose last step is longer, in deviations without overlap, has not converged.
constexpr double kSmallStep = 0.1;

using Vector6d = Eigen::Matrix<double, 6, 1>;
/// Offset of the clocks, turn (3), lever (3), logarithm of the scale.
constexpr int kUnknowns = 8;
using Unknowns = Eigen::Matrix<double, kUnknowns, 1>;
using Information = Eigen::Matrix<double, kUnknowns, kUnknowns>;
using Jacobian = Eigen::Matrix<double, 6, kUnknowns>;

double usual_step_s(const std::vector<SmoothPath::Pose>& poses) {
  std::vector<double> steps_s;
  for (std::size_t i = 1; i < poses.size(); ++i) steps_s.push_back(poses[i].t_s - poses[i - 1].t_s);
  return maps::median(std::move(steps_s));
}

/// Of y, from the left and the right: motions as the mirrored sensor sees them.
Eigen::Isometry3d mirrored(Eigen::Isometry3d T) {
  T.matrix().row(1) *= -1.0;
  T.matrix().col(1) *= -1.0;
  return T;
}

/// What the fit knows of the two paths.
struct State {
  double lag_s = 0.0;
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
  Eigen::Vector3d lever_m = Eigen::Vector3d::Zero();
  double log_scale = 0.0;

  [[nodiscard]] State plus(const Unknowns& step) const {
    return {lag_s + step[0], R * maps::exp_so3(step.segment<3>(1)), lever_m + step.segment<3>(4),
            log_scale + step[7]};
  }
  /// The given motion that belongs to a motion of the lidar.
  [[nodiscard]] Eigen::Isometry3d motion_of(const Eigen::Isometry3d& T_lidar) const {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.linear() = R * T_lidar.linear() * R.transpose();
    T.translation() =
        std::exp(log_scale) * (R * T_lidar.translation()) + lever_m - T.linear() * lever_m;
    return T;
  }
};

Vector6d between(const Eigen::Isometry3d& expected, const Eigen::Isometry3d& T) {
  Vector6d difference;
  difference << T.translation() - expected.translation(),
      maps::log_so3(expected.linear().transpose() * T.linear());
  return difference;
}

/// Derivatives of the given motion that is expected. The clocks' are those of the scans' motion,
/// which has little noise: with the given poses' own, noise would look like motion.
Jacobian jacobian_of(const State& state, const PathMotion& motion, double aside_s) {
  constexpr double kStep = 1e-5;
  Jacobian jacobian;
  jacobian.col(0) =
      between(state.motion_of(motion.T_earlier), state.motion_of(motion.T_later)) / (2.0 * aside_s);
  for (int k = 1; k < kUnknowns; ++k) {
    const Unknowns step = kStep * Unknowns::Unit(k);
    jacobian.col(k) =
        between(state.plus(-step).motion_of(motion.T), state.plus(step).motion_of(motion.T)) /
        (2.0 * kStep);
  }
  return jacobian;
}

struct Residual {
  const PathMotion* motion = nullptr;
  Eigen::Isometry3d T_given;
  Vector6d value;
};

class Fit {
 public:
  Fit(const PathMotions& motions, const SmoothPath& given, const State& start)
      : motions_(motions), given_(given), state_(start) {}

  /// @return false without enough motions in common.
  [[nodiscard]] bool solve() {
    for (int round = 0; round < kFitRounds; ++round) {
      if (!update_residuals()) return false;
      if (round == 0) align();
      const Unknowns step = step_of();
      if (!step.allFinite()) return false;
      state_ = state_.plus(step);
      if (std::abs(step[0]) < 1e-5 && step.tail<7>().norm() < 1e-6) return update_residuals();
    }
    return update_residuals();
  }

  [[nodiscard]] PathDifference result() const {
    const Information A = information() + prior();
    const Information A_inverse = A.ldlt().solve(Information::Identity());
    const Information covariance = covariance_of(A_inverse);
    const auto sigma = [&](int k) { return std::sqrt(covariance(k, k)); };
    PathDifference found;
    found.converged = last_step_ < kSmallStep;
    found.offset_s = {-state_.lag_s, sigma(0)};
    found.scale = {std::exp(state_.log_scale), std::exp(state_.log_scale) * sigma(7)};
    found.R_given_lidar = state_.R;
    found.lever_m = state_.lever_m / found.scale.value;
    found.R_covariance = covariance.block<3, 3>(1, 1);
    for (int k = 0; k < 3; ++k) found.lever_sigma_m[k] = sigma(4 + k) / found.scale.value;
    found.residual_m = sigma_m_;
    found.residual_rad = sigma_rad_;
    found.explained_m = explained(0, sigma_m_);
    found.explained_rad = explained(3, sigma_rad_);
    found.independent = independent_;
    found.outlier_share = outlier_share();
    found.usual_m = usual_m();
    return found;
  }

 private:
  /// Residuals and their deviations.
  bool update_residuals() {
    residuals_.clear();
    for (const PathMotion& motion : motions_.all) {
      const double t_s = motion.t_s + state_.lag_s;
      const auto T = given_.motion(t_s, t_s + motions_.length_s);
      if (T) residuals_.push_back({&motion, *T, between(state_.motion_of(motion.T), *T)});
    }
    if (residuals_.size() < kFewestMotions) return false;
    independent_ = motions_.independent(residuals_.size());
    sigma_m_ = std::max(kLeastLeftM, deviation(0));
    sigma_rad_ = std::max(kLeastLeftRad, deviation(3));
    return independent_ >= kFewestIndependent;
  }

  [[nodiscard]] double deviation(int first) const {
    std::vector<double> sizes;
    for (const Residual& residual : residuals_)
      for (int k = first; k < first + 3; ++k) sizes.push_back(std::abs(residual.value[k]));
    return maps::kMedianToDeviation * maps::median(std::move(sizes));
  }

  /// The turn that brings the directions of both paths together, to start with.
  void align() {
    Eigen::Matrix3d together = Eigen::Matrix3d::Zero();
    for (const Residual& residual : residuals_) {
      const Eigen::Vector3d turn = maps::log_so3(residual.T_given.linear()),
                            lidar_turn = maps::log_so3(residual.motion->T.linear());
      const Eigen::Vector3d& translation = residual.T_given.translation();
      const Eigen::Vector3d& lidar_translation = residual.motion->T.translation();
      // A turn of a degree counts as much as a metre.
      constexpr double kMetresPerRad = 57.0;
      together += kMetresPerRad * kMetresPerRad * turn * lidar_turn.transpose() +
                  translation * lidar_translation.transpose();
    }
    const maps::SingularValues svd = maps::svd_of(together);
    Eigen::Vector3d signs = Eigen::Vector3d::Ones();
    signs.z() = (svd.U * svd.V.transpose()).determinant() > 0.0 ? 1.0 : -1.0;
    // Where motions do not tell a turn, as along a straight line, it stays none.
    if (!(svd.values[1] > 1e-3 * svd.values[0])) return;
    state_.R = svd.U * signs.asDiagonal() * svd.V.transpose();
    update_residuals();
  }

  [[nodiscard]] Vector6d weights_of(const Residual& residual) const {
    Vector6d weights;
    weights.head<3>().setConstant(1.0 / (sigma_m_ * sigma_m_));
    weights.tail<3>().setConstant(1.0 / (sigma_rad_ * sigma_rad_));
    const auto robust = [](double squared) { return 1.0 / (1.0 + squared / (kRobust * kRobust)); };
    weights.head<3>() *=
        robust(residual.value.head<3>().squaredNorm() / (3.0 * sigma_m_ * sigma_m_));
    weights.tail<3>() *=
        robust(residual.value.tail<3>().squaredNorm() / (3.0 * sigma_rad_ * sigma_rad_));
    return weights;
  }

  /// Nothing is known before but that it is no world away.
  [[nodiscard]] static Information prior() {
    Unknowns sigma;
    sigma << 5.0, 3.0, 3.0, 3.0, 10.0, 10.0, 10.0, 2.0;
    return sigma.array().square().inverse().matrix().asDiagonal();
  }

  void for_each(const std::function<void(std::size_t, const Jacobian&, const Vector6d&,
                                         const Vector6d&)>& visit) const {
    for (std::size_t i = 0; i < residuals_.size(); ++i)
      visit(i, jacobian_of(state_, *residuals_[i].motion, motions_.aside_s),
            weights_of(residuals_[i]), residuals_[i].value);
  }

  [[nodiscard]] Information information() const {
    Information A = Information::Zero();
    for_each([&](std::size_t, const Jacobian& J, const Vector6d& weights, const Vector6d&) {
      A += J.transpose() * weights.asDiagonal() * J;
    });
    return A;
  }

  [[nodiscard]] Unknowns step_of() {
    Information A = prior();
    Unknowns b = Unknowns::Zero();
    for_each([&](std::size_t, const Jacobian& J, const Vector6d& weights, const Vector6d& value) {
      A += J.transpose() * weights.asDiagonal() * J;
      b += J.transpose() * weights.asDiagonal() * value;
    });
    Unknowns step = A.ldlt().solve(b);
    last_step_ = std::sqrt(std::max(0.0, b.dot(step)));
    // The given motion at a later time is that which is expected of a later scan.
    step[0] = -std::clamp(step[0], -kNearLagS, kNearLagS);
    const double turn = step.segment<3>(1).norm();
    if (turn > 0.5) step.segment<3>(1) *= 0.5 / turn;
    return step;
  }

  /// Motions that overlap share their errors, and errors of poses last: from how differently
  /// stretches pull, and no less than if each stretch were one motion.
  [[nodiscard]] Information covariance_of(const Information& A_inverse) const {
    const double per_stretch = static_cast<double>(residuals_.size()) / independent_;
    const double stretches_a_part = std::max(1.0, independent_ / 30.0);
    const auto motions_a_part =
        std::max<std::size_t>(1, static_cast<std::size_t>(2.0 * per_stretch * stretches_a_part));
    std::vector<Unknowns> gradients(residuals_.size() / motions_a_part + 1, Unknowns::Zero());
    for_each([&](std::size_t i, const Jacobian& J, const Vector6d& weights, const Vector6d& value) {
      gradients[i / motions_a_part] += J.transpose() * weights.asDiagonal() * value;
    });
    Information spread = Information::Zero();
    for (const Unknowns& gradient : gradients) spread += gradient * gradient.transpose();
    const Information by_stretches = A_inverse * spread * A_inverse;
    const Information covariance = per_stretch * A_inverse;
    Unknowns wider;
    for (int k = 0; k < kUnknowns; ++k)
      wider[k] = std::sqrt(std::max(1.0, by_stretches(k, k) / covariance(k, k)));
    return wider.asDiagonal() * covariance * wider.asDiagonal();
  }

  [[nodiscard]] double outlier_share() const {
    const auto count = std::ranges::count_if(residuals_, [&](const Residual& residual) {
      return residual.value.head<3>().norm() > kOutlierDeviations * std::sqrt(3.0) * sigma_m_ ||
             residual.value.tail<3>().norm() > kOutlierDeviations * std::sqrt(3.0) * sigma_rad_;
    });
    return static_cast<double>(count) / static_cast<double>(residuals_.size());
  }

  [[nodiscard]] double usual_m() const {
    std::vector<double> lengths_m;
    for (const Residual& residual : residuals_)
      lengths_m.push_back(residual.T_given.translation().norm());
    return maps::median(std::move(lengths_m));
  }

  [[nodiscard]] double explained(int first, double left) const {
    Vector6d sum = Vector6d::Zero(), squares = Vector6d::Zero();
    const Eigen::Isometry3d none = Eigen::Isometry3d::Identity();
    for (const Residual& residual : residuals_) {
      const Vector6d given = between(none, residual.T_given);
      sum += given;
      squares += given.cwiseProduct(given);
    }
    const auto n = static_cast<double>(residuals_.size());
    const Vector6d variances = squares / n - (sum / n).cwiseProduct(sum / n);
    return 1.0 - left * left / std::max(variances.segment<3>(first).mean(), 1e-12);
  }

  const PathMotions& motions_;
  const SmoothPath& given_;
  State state_;
  std::vector<Residual> residuals_;
  /// Length of the last step, in deviations.
  double last_step_ = 0.0;
  double sigma_m_ = kLeastLeftM;
  double sigma_rad_ = kLeastLeftRad;
  double independent_ = 0.0;
};

}  // namespace

std::optional<PathDifference> path_difference(const PathPair& paths, bool is_mirrored,
                                              std::optional<double> offset_s) {
  if (paths.odometry.size() < kFewestMotions || paths.given.size() < kFewestMotions)
    return std::nullopt;
  const double step_s = usual_step_s(paths.odometry);
  const double slower_s = std::max(step_s, usual_step_s(paths.given));
  const double box_s = std::max(kLeastBoxS, kBoxSteps * slower_s);
  std::vector<SmoothPath::Pose> seen = paths.odometry;
  if (is_mirrored)
    for (SmoothPath::Pose& pose : seen) pose.T = mirrored(pose.T);
  const PathMotions motions = motions_of(seen, box_s, step_s);
  if (motions.all.size() < kFewestMotions) return std::nullopt;
  const SmoothPath given(paths.given, box_s);
  State start;
  start.lag_s = offset_s ? -*offset_s : best_lag_s(motions, given, 0.2 * box_s);
  Fit fit(motions, given, start);
  if (!fit.solve()) return std::nullopt;
  return fit.result();
}

PathPair part_of(const PathPair& paths, double begin_s, double end_s) {
  PathPair part{.odometry = {}, .given = paths.given};
  for (const SmoothPath::Pose& pose : paths.odometry)
    if (pose.t_s >= begin_s && pose.t_s < end_s) part.odometry.push_back(pose);
  return part;
}

}  // namespace stillmap::mapping
