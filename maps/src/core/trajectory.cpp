#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/trajectory.hpp>

#include <algorithm>
#include <stdexcept>
#include <string>

namespace stillmap::maps {
namespace {

/// Pose on the line through two poses: 0 at `a`, 1 at `b`, continued outside.
Eigen::Isometry3d along(const StampedPose& a, const StampedPose& b, double fraction) {
  const Eigen::AngleAxisd turn(
      Eigen::Quaterniond(a.T_map_lidar.linear().transpose() * b.T_map_lidar.linear()).normalized());
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = a.T_map_lidar.linear() *
               Eigen::AngleAxisd(fraction * turn.angle(), turn.axis()).toRotationMatrix();
  T.translation() =
      (1.0 - fraction) * a.T_map_lidar.translation() + fraction * b.T_map_lidar.translation();
  return renormalized(T);
}

}  // namespace

double seconds_between(std::int64_t from_ns, std::int64_t to_ns) {
  if (to_ns < from_ns) return -seconds_between(to_ns, from_ns);
  return 1e-9 * static_cast<double>(static_cast<std::uint64_t>(to_ns) -
                                    static_cast<std::uint64_t>(from_ns));
}

Trajectory::Trajectory(std::vector<StampedPose> poses) : poses_(std::move(poses)) {
  for (std::size_t i = 0; i < poses_.size(); ++i) {
    if (!poses_[i].T_map_lidar.matrix().allFinite()) {
      throw std::invalid_argument("trajectory: pose " + std::to_string(i) + " is not finite");
    }
    if (i > 0 && poses_[i].stamp_ns <= poses_[i - 1].stamp_ns) {
      throw std::invalid_argument("trajectory: stamp " + std::to_string(poses_[i].stamp_ns) +
                                  " ns of pose " + std::to_string(i) +
                                  " is not after the one before");
    }
  }
}

std::optional<Eigen::Isometry3d> Trajectory::at(std::int64_t stamp_ns,
                                                double max_extrapolation_s) const {
  if (!(max_extrapolation_s >= 0.0)) {
    throw std::invalid_argument("max_extrapolation_s: " + std::to_string(max_extrapolation_s) +
                                ", must be >= 0");
  }
  const auto after = std::lower_bound(
      poses_.begin(), poses_.end(), stamp_ns,
      [](const StampedPose& pose, std::int64_t stamp) { return pose.stamp_ns < stamp; });
  if (after != poses_.end() && after->stamp_ns == stamp_ns) return after->T_map_lidar;
  if (poses_.size() < 2) return std::nullopt;
  const double before_start_s = seconds_between(stamp_ns, poses_.front().stamp_ns);
  const double beyond_end_s = seconds_between(poses_.back().stamp_ns, stamp_ns);
  if (std::max(before_start_s, beyond_end_s) > max_extrapolation_s) return std::nullopt;
  const auto b = std::clamp(after, poses_.begin() + 1, poses_.end() - 1);
  const auto a = b - 1;
  return along(*a, *b,
               seconds_between(a->stamp_ns, stamp_ns) / seconds_between(a->stamp_ns, b->stamp_ns));
}

}  // namespace stillmap::maps
