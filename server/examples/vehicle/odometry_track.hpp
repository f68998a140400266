#pragma once

#include <stillmap/maps/trajectory.hpp>

#include <Eigen/Geometry>

#include <cstdint>
#include <deque>
#include <optional>

namespace stillmap::vehicle {

/// The last 10 s of the vehicle's odometry.
class OdometryTrack {
 public:
  /// A stamp that is older than the last by over 1 s starts the track again: a recording that is
  /// played anew, or a clock that was set back. Others that are not newer are left out.
  void add(std::int64_t stamp_ns, const Eigen::Isometry3d& T_odom_base);

  /// Between two neighbours; up to 0.2 s beyond the newest at constant velocity.
  /// @return nothing where odometry does not tell.
  [[nodiscard]] std::optional<Eigen::Isometry3d> at(std::int64_t stamp_ns) const;

  [[nodiscard]] bool empty() const { return poses_.empty(); }

 private:
  std::deque<maps::StampedPose> poses_;
};

}  // namespace stillmap::vehicle
