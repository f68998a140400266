#pragma once

#include <Eigen/Core>

#include <optional>
#include <vector>

namespace stillmap::mapping {

/// Where something is and how fast, seen from above. Both axes share one covariance.
struct MotionState {
  Eigen::Vector2d position = Eigen::Vector2d::Zero();  ///< [m]
  Eigen::Vector2d velocity_mps = Eigen::Vector2d::Zero();
  /// Of position and velocity along one axis [m^2, m^2/s, m^2/s^2].
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Identity();
};

/// How something may move.
struct MotionNoise {
  /// Density of the accelerations, taken as white [m^2/s^3].
  double acceleration_density = 4.0;
  /// Deviation of a speed of which nothing is known [m/s].
  double unknown_speed_mps = 8.0;
};

/// Kalman filter of constant velocity with white acceleration (Bar-Shalom, Li, Kirubarajan,
/// "Estimation with Applications to Tracking and Navigation", 2001, eq. 6.2.2-10 to 6.2.2-12 and
/// 5.2.3).
[[nodiscard]] MotionState started_at(const Eigen::Vector2d& position, double sigma_m,
                                     const MotionNoise& noise);
[[nodiscard]] MotionState predicted(const MotionState& state, double dt_s,
                                    const MotionNoise& noise);
[[nodiscard]] MotionState updated(const MotionState& state, const Eigen::Vector2d& position,
                                  double sigma_m);

/// A time of a path, with the position measured there if one was.
struct PathStep {
  double time_s = 0.0;
  std::optional<Eigen::Vector2d> position;
  double sigma_m = 0.3;
};

/// Forward and backward over a whole path (Rauch, Tung, Striebel, "Maximum likelihood estimates of
/// linear dynamic systems", AIAA Journal 1965): what lies between measurements is interpolated,
/// what lies before the first and after the last goes on at the speed there.
/// @param steps  times increasing, at least one with a position.
[[nodiscard]] std::vector<MotionState> smoothed_path(const std::vector<PathStep>& steps,
                                                     const MotionNoise& noise);

}  // namespace stillmap::mapping
