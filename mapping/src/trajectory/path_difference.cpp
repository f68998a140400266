#include "trajectory/path_difference.hpp"

#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/median.hpp>
#include <stillmap/maps/small_matrices.hpp>

#include <Eigen/Cholesky>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <functional>
#include <unordered_map>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Poses are smoothed over so long, or so many steps of the slower path.
constexpr double kLeastBoxS = 0.5;
constexpr double kBoxSteps = 4.0;
/// Motions last so long, or twice the box.
constexpr double kLeastMotionS = 1.0;
constexpr std::size_t kMostMotions = 800;
constexpr std::size_t kFewestMotions = 20;
constexpr double kFewestIndependent = 3.0;
constexpr double kMostLagS = 120.0;
/// Within this lag least squares find the way alone.
constexpr double kNearLagS = 0.3;
/// Another lag counts where the logarithm of its likelihood is larger by this, in all and for each
/// independent stretch; and larger than everywhere else.
constexpr double kLagGain = 10.0;
constexpr double kLagGainEach = 0.35;
constexpr double kLagUnlikeOthers = 5.0;
/// Least deviations of one direction of a motion: odometry's own [m, rad].
constexpr double kLeastLeftM = 0.005;
constexpr double kLeastLeftRad = 3e-4;
/// What a length and a turn over a motion may differ by for other reasons [m, rad].
constexpr double kFloorM = 0.02;
constexpr double kFloorRad = 2e-3;
/// A residual of so many deviations has half its weight.
constexpr double kRobust = 3.0;
/// So many deviations in all directions are no noise.
constexpr double kOutlierDeviations = 5.0;
constexpr int kFitRounds = 25;
/// Steps that are still longer after all rounds, in deviations, are no convergence.
constexpr double kSmallStep = 0.01;

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

/// Scans' motions, how they would look a little earlier and later, and when they began.
struct Motion {
  double t_s = 0.0;
  Eigen::Isometry3d T, T_earlier, T_later;
};

struct Motions {
  double length_s = 0.0;
  double box_s = 0.0;
  /// Of `T_earlier` and `T_later`.
  double aside_s = 0.0;
  /// From each to the next, but for pauses.
  double apart_s = 0.0;
  std::vector<Motion> all;

  /// Stretches among so many motions that are independent.
  [[nodiscard]] double independent(std::size_t motions) const {
    return static_cast<double>(motions) * std::min(1.0, apart_s / (length_s + box_s));
  }
};

/// A motion's length and angle.
struct Amount {
  double length_m = 0.0;
  double angle_rad = 0.0;
};

Amount amount_of(const Eigen::Isometry3d& T) {
  return {T.translation().norm(), maps::log_so3(T.linear()).norm()};
}

/// Mean log-likelihood of one path's amounts given the other's, where their noise is not known.
class LagScore {
 public:
  void add(const Amount& a, const Amount& b) {
    ++count_;
    const std::array<std::array<double, 2>, 2> values{
        {{a.length_m, b.length_m}, {a.angle_rad, b.angle_rad}}};
    for (std::size_t i = 0; i < 2; ++i) {
      const auto& [x, y] = values[i];
      const std::array<double, 5> terms{x, y, x * x, y * y, x * y};
      for (std::size_t k = 0; k < terms.size(); ++k) sums_[i][k] += terms[k];
    }
  }
  [[nodiscard]] std::size_t count() const { return count_; }
  [[nodiscard]] double value() const { return of(sums_[0], kFloorM) + of(sums_[1], kFloorRad); }

 private:
  [[nodiscard]] double of(const std::array<double, 5>& sums, double floor) const {
    const auto n = static_cast<double>(count_);
    const double xx = sums[2] / n - sums[0] * sums[0] / (n * n);
    const double yy = sums[3] / n - sums[1] * sums[1] / (n * n);
    const double xy = std::max(0.0, sums[4] / n - sums[0] * sums[1] / (n * n));
    const double unexplained = std::max(0.0, yy - (xx > 0.0 ? xy * xy / xx : 0.0));
    return -0.5 * std::log((unexplained + floor * floor) / (yy + floor * floor));
  }

  std::size_t count_ = 0;
  std::array<std::array<double, 5>, 2> sums_{};
};

/// Which lag of the given poses' clock makes them move and turn as the scans do: 0, or another
/// where that explains much more. A given pose of t + lag belongs to the scan of t.
class LagSearch {
 public:
  LagSearch(const Motions& motions, const SmoothPath& given, double step_s)
      : motions_(motions), path_(given), step_s_(step_s) {
    for (const Motion& motion : motions.all) of_scans_.push_back(amount_of(motion.T));
  }

  [[nodiscard]] double best_s() const {
    const auto most = static_cast<long>(kMostLagS / step_s_);
    struct Likely {
      double lag_s = 0.0, value = 0.0, independent = 0.0;
    };
    std::vector<Likely> likely;
    for (long lag = -most; lag <= most; ++lag) {
      const double lag_s = static_cast<double>(lag) * step_s_;
      const LagScore score = at(lag_s);
      if (3 * score.count() >= of_scans_.size() && score.count() >= kFewestMotions)
        likely.push_back({lag_s, score.value(), motions_.independent(score.count())});
    }
    const auto best_where = [&](const auto& takes) {
      Likely best;
      for (const Likely& each : likely)
        if (takes(each.lag_s) && each.value > best.value) best = each;
      return best;
    };
    const auto best = best_where([](double) { return true; });
    const auto near = best_where([](double lag_s) { return std::abs(lag_s) <= kNearLagS; });
    const auto other = best_where([&](double lag_s) {
      return std::abs(lag_s - best.lag_s) > motions_.length_s + motions_.box_s;
    });
    const double gain = best.value - near.value;
    const bool is_better = gain > kLagGainEach && best.independent * gain > kLagGain &&
                           best.independent * (best.value - other.value) > kLagUnlikeOthers;
    return is_better ? best.lag_s : 0.0;
  }

 private:
  [[nodiscard]] LagScore at(double lag_s) const {
    LagScore score;
    for (std::size_t i = 0; i < of_scans_.size(); ++i) {
      const auto& amount =
          given_at(std::lround((motions_.all[i].t_s + lag_s - path_.begin_s()) / step_s_));
      if (amount) score.add(of_scans_[i], *amount);
    }
    return score;
  }
  /// Of the given motion so many steps behind the begin of its path. Only those that are asked for
  /// are taken: a path may reach for years beyond the scans.
  [[nodiscard]] const std::optional<Amount>& given_at(long step) const {
    const auto [at, is_new] = given_.try_emplace(step);
    if (is_new) {
      const double t_s = path_.begin_s() + static_cast<double>(step) * step_s_;
      if (const auto T = path_.motion(t_s, t_s + motions_.length_s)) at->second = amount_of(*T);
    }
    return at->second;
  }

  const Motions& motions_;
  const SmoothPath& path_;
  double step_s_;
  mutable std::unordered_map<long, std::optional<Amount>> given_;
  std::vector<Amount> of_scans_;
};

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
Jacobian jacobian_of(const State& state, const Motion& motion, double aside_s) {
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
  const Motion* motion = nullptr;
  Eigen::Isometry3d T_given;
  Vector6d value;
};

class Fit {
 public:
  Fit(const Motions& motions, const SmoothPath& given, const State& start)
      : motions_(motions), given_(given), state_(start) {}

  /// @return false without convergence, or without enough motions in common.
  [[nodiscard]] bool solve() {
    for (int round = 0; round < kFitRounds; ++round) {
      if (!update_residuals()) return false;
      if (round == 0) align();
      const Unknowns step = step_of();
      if (!step.allFinite()) return false;
      state_ = state_.plus(step);
      if (std::abs(step[0]) < 1e-5 && step.tail<7>().norm() < 1e-6) return update_residuals();
    }
    return last_step_ < kSmallStep && update_residuals();
  }

  [[nodiscard]] PathDifference result() const {
    const Information A = information() + prior();
    const Information A_inverse = A.ldlt().solve(Information::Identity());
    const Information covariance = covariance_of(A_inverse);
    const auto sigma = [&](int k) { return std::sqrt(covariance(k, k)); };
    PathDifference found;
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
    for (const Motion& motion : motions_.all) {
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

  const Motions& motions_;
  const SmoothPath& given_;
  State state_;
  std::vector<Residual> residuals_;
  /// Length of the last step, in deviations.
  double last_step_ = 0.0;
  double sigma_m_ = kLeastLeftM;
  double sigma_rad_ = kLeastLeftRad;
  double independent_ = 0.0;
};

/// From every pose, or every so many: pauses hold none.
Motions motions_of(const std::vector<SmoothPath::Pose>& poses, double box_s, double step_s) {
  const SmoothPath path(poses, box_s);
  const std::size_t stride = (poses.size() + kMostMotions - 1) / kMostMotions;
  Motions motions{.length_s = std::max(kLeastMotionS, 2.0 * box_s),
                  .box_s = box_s,
                  .aside_s = 0.25 * box_s,
                  .apart_s = static_cast<double>(stride) * step_s,
                  .all = {}};
  for (std::size_t i = 0; i < poses.size(); i += stride) {
    const double t_s = poses[i].t_s;
    const auto seen = [&](double aside_s) {
      return path.motion(t_s + aside_s, t_s + aside_s + motions.length_s, true);
    };
    const auto T = seen(0.0), earlier = seen(-motions.aside_s), later = seen(motions.aside_s);
    if (T && earlier && later) motions.all.push_back({t_s, *T, *earlier, *later});
  }
  return motions;
}

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
  const Motions motions = motions_of(seen, box_s, step_s);
  if (motions.all.size() < kFewestMotions) return std::nullopt;
  const SmoothPath given(paths.given, box_s);
  State start;
  start.lag_s = offset_s ? -*offset_s : LagSearch(motions, given, 0.2 * box_s).best_s();
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
