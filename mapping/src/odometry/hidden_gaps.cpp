#include "odometry/hidden_gaps.hpp"

#include "odometry/scan_period.hpp"

#include <stillmap/maps/deskew.hpp>
#include <stillmap/maps/frames.hpp>

#include <algorithm>
#include <cstddef>
#include <iterator>

namespace stillmap::mapping {
namespace {

/// Deviations of a speed that was found over one step [m/s], and of accelerations [m/s^2].
constexpr double kSpeedOff = 0.3;
constexpr double kAccelerationOff = 2.0;

double seconds_between(std::int64_t from_ns, std::int64_t to_ns) {
  return 1e-9 * static_cast<double>(to_ns - from_ns);
}

/// As far as speeds are believed to lead.
double led_s(std::int64_t from_ns, std::int64_t to_ns) {
  return std::min(seconds_between(from_ns, to_ns), ScanPeriod::kMaxGapS);
}

/// How much of what a prediction is off by after `all_s` it was off by before, at a share of that
/// time.
double off_share(double share, double all_s) {
  const double by_speed = kSpeedOff * kSpeedOff;
  const double by_acceleration = 0.25 * kAccelerationOff * kAccelerationOff * all_s * all_s;
  return share * (by_speed + share * by_acceleration) / (by_speed + by_acceleration);
}

/// @param first  the first scan that is seen.
void place_before(std::size_t first, std::span<const std::int64_t> stamps_ns,
                  std::vector<OdometryPose>& poses) {
  if (first + 1 >= poses.size() || poses[first + 1].status == OdometryStatus::kPredicted) return;
  const Eigen::Isometry3d T_first_next =
      poses[first].T_odom_lidar.inverse() * poses[first + 1].T_odom_lidar;
  const Eigen::Matrix<double, 6, 1> twist =
      maps::log_se3(T_first_next) / seconds_between(stamps_ns[first], stamps_ns[first + 1]);
  for (std::size_t i = 0; i < first; ++i) {
    const double before_s = led_s(stamps_ns[i], stamps_ns[first]);
    poses[i].T_odom_lidar =
        maps::renormalized(poses[first].T_odom_lidar * maps::exp_se3(-before_s * twist));
    poses[i].twist_lidar = twist;
  }
}

}  // namespace

void join_over_hidden(std::span<const std::int64_t> stamps_ns, std::vector<OdometryPose>& poses) {
  const auto seen_from = [&](std::size_t begin) {
    const auto at = std::find_if(poses.begin() + static_cast<std::ptrdiff_t>(begin), poses.end(),
                                 [](const OdometryPose& pose) { return !pose.hidden; });
    return static_cast<std::size_t>(std::distance(poses.begin(), at));
  };
  const std::size_t first = seen_from(0);
  if (first > 0 && first < poses.size()) place_before(first, stamps_ns, poses);
  for (std::size_t begin = first + 1; begin < poses.size(); ++begin) {
    const std::size_t end = seen_from(begin);
    if (end == begin) continue;
    if (end == poses.size()) return;
    const OdometryPose& last = poses[end - 1];
    const Eigen::Isometry3d T_predicted =
        last.T_odom_lidar *
        maps::exp_se3(led_s(stamps_ns[end - 1], stamps_ns[end]) * last.twist_lidar);
    const Eigen::Matrix<double, 6, 1> off =
        maps::log_se3(T_predicted.inverse() * poses[end].T_odom_lidar);
    const double all_s = seconds_between(stamps_ns[begin - 1], stamps_ns[end]);
    for (std::size_t i = begin; i < end; ++i) {
      const double share = seconds_between(stamps_ns[begin - 1], stamps_ns[i]) / all_s;
      poses[i].T_odom_lidar =
          maps::renormalized(poses[i].T_odom_lidar * maps::exp_se3(off_share(share, all_s) * off));
    }
    begin = end;
  }
}

}  // namespace stillmap::mapping
