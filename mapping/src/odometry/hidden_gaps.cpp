#include "odometry/hidden_gaps.hpp"

#include "odometry/scan_period.hpp"

#include <stillmap/maps/deskew.hpp>
#include <stillmap/maps/frames.hpp>

#include <algorithm>
#include <cstddef>

namespace stillmap::mapping {

void join_over_hidden(std::span<const std::int64_t> stamps_ns, std::vector<OdometryPose>& poses) {
  const auto seconds = [&](std::size_t from, std::size_t to) {
    return 1e-9 * static_cast<double>(stamps_ns[to] - stamps_ns[from]);
  };
  for (std::size_t begin = 1; begin < poses.size(); ++begin) {
    if (!poses[begin].hidden) continue;
    std::size_t end = begin;
    while (end < poses.size() && poses[end].hidden) ++end;
    if (end == poses.size()) return;
    const OdometryPose& last = poses[end - 1];
    const double step_s = std::min(seconds(end - 1, end), ScanPeriod::kMaxGapS);
    const Eigen::Isometry3d T_predicted =
        last.T_odom_lidar * maps::exp_se3(last.twist_lidar * step_s);
    const Eigen::Matrix<double, 6, 1> off =
        maps::log_se3(T_predicted.inverse() * poses[end].T_odom_lidar);
    for (std::size_t i = begin; i < end; ++i) {
      const double share = seconds(begin - 1, i) / seconds(begin - 1, end);
      poses[i].T_odom_lidar =
          maps::renormalized(poses[i].T_odom_lidar * maps::exp_se3(share * share * off));
    }
    begin = end;
  }
}

}  // namespace stillmap::mapping
