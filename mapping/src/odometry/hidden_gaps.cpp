#include "odometry/hidden_gaps.hpp"

#include "odometry/scan_period.hpp"

#include <stillmap/maps/deskew.hpp>
#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/trajectory.hpp>

#include <algorithm>
#include <cstddef>
#include <iterator>

namespace stillmap::mapping {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;

/// Extrapolation time, at most kMaxGapS.
double led_s(std::int64_t from_ns, std::int64_t to_ns) {
  return std::min(maps::seconds_between(from_ns, to_ns), ScanPeriod::kMaxGapS);
}

/// @param first  the first scan that is seen.
void place_before(std::size_t first, std::span<const std::int64_t> stamps_ns,
                  std::vector<OdometryPose>& poses) {
  if (first + 1 >= poses.size() || poses[first + 1].status == OdometryStatus::kPredicted) return;
  const Eigen::Isometry3d T_first_next =
      poses[first].T_odom_lidar.inverse() * poses[first + 1].T_odom_lidar;
  const Vector6d twist =
      maps::log_se3(T_first_next) / maps::seconds_between(stamps_ns[first], stamps_ns[first + 1]);
  for (std::size_t i = 0; i < first; ++i) {
    const double before_s = led_s(stamps_ns[i], stamps_ns[first]);
    poses[i].T_odom_lidar =
        maps::renormalized(poses[first].T_odom_lidar * maps::exp_se3(-before_s * twist));
    poses[i].twist_lidar = twist;
  }
}

/// Places the hidden scans [begin, end) between two that are seen.
void place_between(std::size_t begin, std::size_t end, std::span<const std::int64_t> stamps_ns,
                   std::vector<OdometryPose>& poses) {
  const auto seconds = [&](std::size_t from, std::size_t to) {
    return maps::seconds_between(stamps_ns[from], stamps_ns[to]);
  };
  const OdometryPose& before = poses[begin - 1];
  const double gap_s = seconds(begin - 1, end);
  const double step_s = begin > 1 ? seconds(begin - 2, begin - 1) : gap_s;
  const Vector6d way = maps::log_se3(before.T_odom_lidar.inverse() * poses[end].T_odom_lidar);
  // Speeds over a time are those in its middle. Over a pause they tell nothing.
  Vector6d acceleration = (way / gap_s - before.twist_lidar) / (0.5 * (step_s + gap_s));
  if (gap_s > ScanPeriod::kMaxGapS) {
    acceleration.setZero();
  } else if (end + 1 < poses.size() && poses[end + 1].status != OdometryStatus::kPredicted) {
    const Vector6d twist =
        maps::log_se3(poses[end].T_odom_lidar.inverse() * poses[end + 1].T_odom_lidar) /
        seconds(end, end + 1);
    acceleration =
        (twist - before.twist_lidar) / (0.5 * step_s + gap_s + 0.5 * seconds(end, end + 1));
  }
  for (std::size_t i = begin; i < end; ++i) {
    const double t_s = seconds(begin - 1, i);
    poses[i].T_odom_lidar = maps::renormalized(
        before.T_odom_lidar *
        maps::exp_se3(t_s / gap_s * way - 0.5 * t_s * (gap_s - t_s) * acceleration));
    poses[i].twist_lidar = way / gap_s + (t_s - 0.5 * gap_s) * acceleration;
  }
}

}  // namespace

void interpolate_hidden(std::span<const std::int64_t> stamps_ns, std::vector<OdometryPose>& poses) {
  const auto seen_from = [&](std::size_t begin) {
    const auto at = std::find_if(poses.begin() + static_cast<std::ptrdiff_t>(begin), poses.end(),
                                 [](const OdometryPose& pose) { return !pose.hidden; });
    return static_cast<std::size_t>(std::distance(poses.begin(), at));
  };
  const std::size_t first = seen_from(0);
  if (first > 0 && first < poses.size()) place_before(first, stamps_ns, poses);
  for (std::size_t begin = first + 1; begin < poses.size(); ++begin) {
    const std::size_t end = seen_from(begin);
    if (end == poses.size()) return;
    if (end > begin) place_between(begin, end, stamps_ns, poses);
    begin = end;
  }
}

}  // namespace stillmap::mapping
