#include "motion.hpp"

#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/small_matrices.hpp>
#include <stillmap/maps/trajectory.hpp>

#include <cmath>

namespace stillmap::localization {
namespace {

Matrix6d diagonal(double translation, double rotation) {
  Vector6d values;
  values << Eigen::Vector3d::Constant(translation), Eigen::Vector3d::Constant(rotation);
  return values.asDiagonal();
}

double largest_deviation_m(const Matrix6d& covariance) {
  return std::sqrt(covariance.diagonal().head<3>().maxCoeff());
}

Matrix6d symmetric(const Matrix6d& matrix) { return 0.5 * (matrix + matrix.transpose()); }

}  // namespace

MotionModel::MotionModel(const TrackerOptions& options)
    : density_(diagonal(options.acceleration_density, options.turn_acceleration_density)),
      unknown_twist_(diagonal(options.unknown_speed_m_s * options.unknown_speed_m_s,
                              options.unknown_turn_rad_s * options.unknown_turn_rad_s)) {}

MotionState MotionModel::at_unknown_velocity(std::int64_t stamp_ns, const PosePdf& pose) const {
  return {stamp_ns, pose, Vector6d::Zero(), unknown_twist_};
}

MotionState MotionModel::predicted(const MotionState& state, std::int64_t stamp_ns) const {
  const double t = maps::seconds_between(state.stamp_ns, stamp_ns);
  if (t == 0.0) return state;
  MotionState next = state;
  next.stamp_ns = stamp_ns;
  const PosePdf start{state.pose.T, 2.0 * state.pose.covariance};
  const PosePdf motion{maps::exp_se3(state.twist * t),
                       2.0 * t * t * state.twist_covariance + t * t * t / 3.0 * density_};
  next.pose = composed(start, motion);
  next.twist_covariance += t * density_;
  next.drift_m = std::hypot(state.drift_m, largest_deviation_m(motion.covariance));
  return next;
}

MotionState MotionModel::predicted(const MotionState& state, std::int64_t stamp_ns,
                                   const OdometryStep& odometry) const {
  const double t = maps::seconds_between(state.stamp_ns, stamp_ns);
  MotionState next;
  next.stamp_ns = stamp_ns;
  next.odometry_steps = state.odometry_steps + 1;
  // n^2 - (n - 1)^2 times the variance.
  const double repeated = 2.0 * next.odometry_steps - 1.0;
  next.pose = composed(state.pose, {odometry.T_since_lidar, repeated * odometry.covariance});
  next.twist = maps::log_se3(odometry.T_since_lidar) / t;
  // The mean velocity of an interval differs from the one at its end.
  next.twist_covariance = odometry.covariance / (t * t) + t / 3.0 * density_;
  next.drift_m =
      std::hypot(state.drift_m, std::sqrt(repeated) * largest_deviation_m(odometry.covariance));
  return next;
}

MotionState MotionModel::moved_to(const MotionState& before, std::int64_t stamp_ns,
                                  const PosePdf& pose) const {
  MotionState next{stamp_ns, pose, before.twist, before.twist_covariance};
  const double t = maps::seconds_between(before.stamp_ns, stamp_ns);
  if (!(t > 0.0)) return next;
  const Matrix6d predicted = before.twist_covariance + t * density_;
  const Vector6d measured = maps::log_se3(before.pose.T.inverse() * pose.T) / t;
  const Matrix6d noise = (before.pose.covariance + pose.covariance) / (t * t) + t / 3.0 * density_;
  // Symmetric matrices, so (S^-1 P)^T = P S^-1.
  const Matrix6d gain = maps::ldlt_solve(predicted + noise, predicted).transpose();
  next.twist += gain * (measured - before.twist);
  next.twist_covariance = symmetric((Matrix6d::Identity() - gain) * predicted);
  return next;
}

MotionState MotionModel::interpolated(const MotionState& before, const MotionState& after,
                                      std::int64_t stamp_ns) const {
  const double span = maps::seconds_between(before.stamp_ns, after.stamp_ns);
  if (!(span > 0.0)) return before;
  const double share = maps::seconds_between(before.stamp_ns, stamp_ns) / span;
  MotionState between;
  between.stamp_ns = stamp_ns;
  between.twist = maps::log_se3(before.pose.T.inverse() * after.pose.T) / span;
  between.twist_covariance = before.twist_covariance + span / 3.0 * density_;
  between.pose.T =
      maps::renormalized(before.pose.T * maps::exp_se3(between.twist * (share * span)));
  // Between two known places with free velocities the path's variance is
  // density T^3 (s (1 - s))^2 / 3 (the process whose mean are cubic splines: Wahba 1978).
  const double bridge = share * (1.0 - share) * span;
  const Matrix6d way = bridge * bridge * span / 3.0 * density_;
  // Weighted sum: true for errors that are fully shared, more than enough for others.
  between.pose.covariance =
      (1.0 - share) * before.pose.covariance + share * after.pose.covariance + way;
  between.drift_m =
      std::hypot((1.0 - share) * before.drift_m + share * after.drift_m, largest_deviation_m(way));
  return between;
}

}  // namespace stillmap::localization
