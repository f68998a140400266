#include "loops/odometry_path.hpp"

#include <stillmap/localization/adjoint.hpp>

#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/small_matrices.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

namespace stillmap::mapping {
namespace {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

/// Share of the way that odometry drifts in position at most, as a deviation: three to five times
/// what it is worth on a street, so that a bad stretch does not hide a loop.
constexpr double kDriftShare = 0.015;
/// The same of rotation [rad/m]: half a degree in 60 m.
constexpr double kTurnDriftRadPerM = 1.5e-4;

}  // namespace

Matrix6d carried(const Eigen::Isometry3d& T, const Matrix6d& covariance) {
  const Matrix6d Ad = localization::adjoint(T);
  return Ad * covariance * Ad.transpose();
}

UncertainMotion composed(const UncertainMotion& a, const UncertainMotion& b) {
  return {maps::renormalized(a.T * b.T), carried(b.T.inverse(), a.covariance) + b.covariance};
}

UncertainMotion inverted(const UncertainMotion& motion) {
  return {motion.T.inverse(), carried(motion.T, motion.covariance)};
}

double chi_squared(const UncertainMotion& a, const UncertainMotion& b) {
  const Vector6d between = maps::log_se3(maps::renormalized(a.T.inverse() * b.T));
  const Matrix6d covariance = carried((a.T.inverse() * b.T).inverse(), a.covariance) + b.covariance;
  return maps::mahalanobis_squared(between, covariance)
      .value_or(std::numeric_limits<double>::infinity());
}

void OdometryPath::append(const Eigen::Isometry3d& T_odom_lidar, const Matrix6d& motion_covariance,
                          std::uint32_t drive) {
  Node node{T_odom_lidar, drive, 0.0, Matrix6d::Zero(), Matrix6d::Zero()};
  if (!nodes_.empty() && nodes_.back().drive == drive) {
    const Node& last = nodes_.back();
    node.travelled_m =
        last.travelled_m + (T_odom_lidar.translation() - last.T_odom_lidar.translation()).norm();
    node.own_sum = last.own_sum + motion_covariance;
    node.sum = last.sum + carried(T_odom_lidar, motion_covariance);
  }
  nodes_.push_back(node);
}

double OdometryPath::way_m(std::size_t a, std::size_t b) const {
  if (nodes_[a].drive != nodes_[b].drive) return std::numeric_limits<double>::infinity();
  return std::abs(nodes_[a].travelled_m - nodes_[b].travelled_m);
}

Matrix6d OdometryPath::covariance_per_m(std::size_t from, std::size_t to) const {
  const double way = way_m(from, to);
  if (!(way > 0.0)) return Matrix6d::Zero();
  return (nodes_[std::max(from, to)].own_sum - nodes_[std::min(from, to)].own_sum) / way;
}

double OdometryPath::least_drift_m(double way_m) { return kDriftShare * way_m; }

UncertainMotion OdometryPath::motion(std::size_t from, std::size_t to) const {
  if (from > to) return inverted(motion(to, from));
  const Node& a = nodes_[from];
  const Node& b = nodes_[to];
  UncertainMotion out{maps::renormalized(a.T_odom_lidar.inverse() * b.T_odom_lidar),
                      carried(b.T_odom_lidar.inverse(), b.sum - a.sum)};
  const double way = way_m(from, to);
  const double drift_m = least_drift_m(way);
  const double turn_rad = kTurnDriftRadPerM * way;
  out.covariance.diagonal().head<3>().array() += drift_m * drift_m;
  out.covariance.diagonal().tail<3>().array() += turn_rad * turn_rad;
  return out;
}

}  // namespace stillmap::mapping
