#include "odometry/gravity.hpp"

#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/imu.hpp>
#include <stillmap/maps/small_matrices.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <numbers>
#include <span>

namespace stillmap::mapping {
namespace {

constexpr std::size_t kGravityScans = 300;
constexpr std::size_t kLeastSteps = 10;
constexpr double kLeastForce = 9.0;
constexpr double kMostForce = 10.6;
/// Of the mean force between two scans, most of it by speeds of scans, and of the bias [m/s^2].
constexpr double kForceSigma = 0.5;
constexpr double kBiasSigma = 0.1;
/// A stronger force is a blow, whose mean is not that of the motion between scans [m/s^2].
constexpr double kBlowForce = 30.0;
/// The ground is hardly steeper than this against gravity [deg].
constexpr double kMostSlopeDeg = 20.0;

/// Readings between two stamps of the scans' clock.
std::span<const maps::ImuReading> readings_between(const maps::Imu& imu, std::int64_t from_ns,
                                                   std::int64_t to_ns) {
  const std::vector<maps::ImuReading>& all = *imu.readings;
  const std::int64_t offset_ns = imu.fit->clock_offset_ns;
  const auto first =
      std::ranges::lower_bound(all, from_ns - offset_ns, {}, &maps::ImuReading::stamp_ns);
  const auto end =
      std::ranges::lower_bound(all, to_ns - offset_ns, {}, &maps::ImuReading::stamp_ns);
  return {first, end};
}

bool has_blow(std::span<const maps::ImuReading> readings) {
  return std::ranges::any_of(readings, [](const maps::ImuReading& reading) {
    return static_cast<double>(reading.force_mps2.norm()) > kBlowForce;
  });
}

/// Mean force in the frame of odometry, with the lidar between two of its orientations.
Eigen::Vector3d mean_force(std::span<const maps::ImuReading> readings,
                           const Eigen::Matrix3d& R_from, const Eigen::Vector3d& turn) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < readings.size(); ++i) {
    const double share = (static_cast<double>(i) + 0.5) / static_cast<double>(readings.size());
    sum += R_from * maps::exp_so3(share * turn) * readings[i].force_mps2.cast<double>();
  }
  return sum / static_cast<double>(readings.size());
}

}  // namespace

Vertical up_in_odom(const maps::Drive& drive, std::size_t begin,
                    std::span<const OdometryPose> poses) {
  const std::shared_ptr<const maps::Imu>& imu = drive.contents().imu;
  if (!imu || !imu->fit) return {};
  // Least squares for gravity's reaction g and bias b: force - acceleration = g + R b.
  maps::Matrix6d A = maps::Matrix6d::Zero();
  maps::Vector6d rhs = maps::Vector6d::Zero();
  A.bottomRightCorner<3, 3>() = Eigen::Matrix3d::Identity() / (kBiasSigma * kBiasSigma);
  std::size_t steps = 0;
  const auto velocity = [&](std::size_t i) {
    const auto way = poses[i].T_odom_lidar.translation() - poses[i - 1].T_odom_lidar.translation();
    return Eigen::Vector3d(way / (1e-9 * static_cast<double>(drive.stamp_ns(begin + i) -
                                                             drive.stamp_ns(begin + i - 1))));
  };
  for (std::size_t i = 2; i < std::min(kGravityScans, poses.size()); ++i) {
    const OdometryPose& from = poses[i - 1];
    const OdometryPose& to = poses[i];
    if (from.status == OdometryStatus::kPredicted || to.status == OdometryStatus::kPredicted)
      continue;
    const std::int64_t from_ns = drive.stamp_ns(begin + i - 1);
    const std::int64_t to_ns = drive.stamp_ns(begin + i);
    const auto readings = readings_between(*imu, from_ns, to_ns);
    if (readings.empty() || has_blow(readings)) continue;
    const Eigen::Matrix3d R_from = from.T_odom_lidar.linear();
    const Eigen::Matrix3d R_to = to.T_odom_lidar.linear();
    const double step_s = 1e-9 * static_cast<double>(to_ns - from_ns);
    const Eigen::Vector3d acceleration = (velocity(i) - velocity(i - 1)) / step_s;
    const Eigen::Vector3d force =
        mean_force(readings, R_from, maps::log_so3(R_from.transpose() * R_to)) - acceleration;
    Eigen::Matrix<double, 3, 6> J;
    J << Eigen::Matrix3d::Identity(), R_to;
    A += J.transpose() * J / (kForceSigma * kForceSigma);
    rhs += J.transpose() * force / (kForceSigma * kForceSigma);
    ++steps;
  }
  if (steps < kLeastSteps)
    return {{}, fmt::format("fewer than {} scans without blows", kLeastSteps)};
  const Eigen::Vector3d up = maps::ldlt_solve(A, rhs).head<3>();
  const double norm = up.norm();
  if (!(norm >= kLeastForce && norm <= kMostForce))
    return {{}, fmt::format("a mean force of {:.2f} m/s^2, expected 9.8: check its unit", norm)};
  return {Eigen::Vector3d(up / norm), {}};
}

std::string level(const Vertical& vertical, bool ground_is_seen, Eigen::Isometry3d& T_ground_odom) {
  if (!vertical.fault.empty())
    return "vertical from the ground, as the accelerometer shows " + vertical.fault;
  if (!vertical.up_odom) return {};
  const Eigen::Vector3d up = T_ground_odom.linear() * *vertical.up_odom;
  const double off_deg = std::atan2(up.head<2>().norm(), up.z()) * 180.0 / std::numbers::pi;
  if (ground_is_seen && off_deg > kMostSlopeDeg)
    return fmt::format(
        "vertical from the ground, as that of the accelerometer is {:.0f} deg off: check its axes "
        "and its sign (upward while the sensor stands)",
        off_deg);
  T_ground_odom.prerotate(maps::turn_between(up, Eigen::Vector3d::UnitZ()));
  return ground_is_seen
             ? fmt::format("vertical from the accelerometer, {:.1f} deg from the ground's", off_deg)
             : "vertical from the accelerometer";
}

}  // namespace stillmap::mapping
