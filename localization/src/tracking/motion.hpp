#pragma once

#include "align/pose_pdf.hpp"

#include <stillmap/localization/tracker.hpp>

#include <cstdint>

namespace stillmap::localization {

/// What a session believes of its vehicle at one time.
struct MotionState {
  std::int64_t stamp_ns = 0;
  /// T_map_lidar.
  PosePdf pose;
  /// (tx ty tz rx ry rz) [m/s, rad/s] in the lidar frame.
  Vector6d twist = Vector6d::Zero();
  Matrix6d twist_covariance = Matrix6d::Identity();
  /// Deviation of the way since a scan was matched [m]: what the motion adds to the pose's error.
  double drift_m = 0.0;
  /// Steps of odometry in a row since a scan told all directions.
  int odometry_steps = 0;
};

/// Vehicles as bodies whose acceleration is white noise (Bar-Shalom, Li, Kirubarajan, "Estimation
/// with Applications to Tracking and Navigation", 2001, 6.2.2), as densities in the options.
class MotionModel {
 public:
  explicit MotionModel(const TrackerOptions& options);

  /// A place without any knowledge of the velocity.
  [[nodiscard]] MotionState at_unknown_velocity(std::int64_t stamp_ns, const PosePdf& pose) const;

  /// Continues a state to a later or equal time. The errors of pose and velocity come from the same
  /// matches, so twice the sum of both covariances bounds theirs whatever their correlation.
  [[nodiscard]] MotionState predicted(const MotionState& state, std::int64_t stamp_ns) const;
  /// The same with the vehicle's odometry, which is independent of the matches. A wheel that is
  /// taken for too large is so at every step, so errors of steps in a row add up as one that is
  /// repeated: n of a deviation s have n s, not sqrt(n) s.
  /// @param stamp_ns  later than the state's.
  [[nodiscard]] MotionState predicted(const MotionState& state, std::int64_t stamp_ns,
                                      const OdometryStep& odometry) const;

  /// Takes a pose at `stamp_ns` over, and what it tells about the velocity since `before` (Kalman
  /// filter on the twist). Where no time has passed the velocity is left.
  [[nodiscard]] MotionState moved_to(const MotionState& before, std::int64_t stamp_ns,
                                     const PosePdf& pose) const;

  /// Between two states, `before.stamp_ns <= stamp_ns <= after.stamp_ns`.
  [[nodiscard]] MotionState interpolated(const MotionState& before, const MotionState& after,
                                         std::int64_t stamp_ns) const;

 private:
  /// Covariance of the change of velocity in a second.
  Matrix6d density_;
  Matrix6d unknown_twist_;
};

}  // namespace stillmap::localization
