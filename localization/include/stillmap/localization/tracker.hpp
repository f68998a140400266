#pragma once

#include <stillmap/localization/aligner.hpp>
#include <stillmap/maps/scan.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::localization {

/// How a session believes vehicles to move, and how long it believes itself without the map.
struct TrackerOptions {
  /// Spectral density of the acceleration, in [1e-4, 1e4]: after t seconds of not being observed
  /// the velocity's deviation is sqrt(density t) [m^2/s^3]. 4 lets a car brake at once.
  double acceleration_density = 4.0;
  /// The same of the turning acceleration [rad^2/s^3], in [1e-6, 1e2].
  double turn_acceleration_density = 0.1;
  /// Deviation of a velocity that nothing has told yet [m/s], in [0.01, 1000].
  double unknown_speed_m_s = 15.0;
  /// The same of the rate of turn [rad/s], in [0.001, 100].
  double unknown_turn_rad_s = 0.5;
  /// Poses are predicted without a match for so long [s], in [0, 60].
  double max_coast_s = 3.0;
  /// A scan is not looked for around a prediction that the motion since the last match may have led
  /// astray by a deviation of more than this [m], in [0.1, 100]; as far as the aligner looks around
  /// a prior.
  double max_drift_m = 6.0;
  /// Matches in a row that contradict the motion, until the motion is doubted, in [1, 1000].
  int max_contradictions = 5;
  /// Scans that are looked for widely around the prediction before the whole map is, in [0, 1000].
  int wide_searches = 3;
  /// Answers in a row that must agree with each other after the vehicle was searched for, before
  /// one is `ok`, the first of them counted, in [1, 100].
  int agreeing_answers = 2;
  /// Answers and states are kept for so long behind the newest [s], in [0, 600].
  double history_s = 5.0;

  [[nodiscard]] std::vector<std::string> violations() const;
};

/// The vehicle's own measure of its motion between two scans.
struct OdometryStep {
  /// Stamp of the scan that the motion starts from; one that was given to `track` before.
  std::int64_t since_ns = 0;
  /// Pose of the lidar at the scan it is sent with, in the lidar frame at `since_ns`.
  Eigen::Isometry3d T_since_lidar = Eigen::Isometry3d::Identity();
  /// Order as in `AlignmentResult`, perturbation on the right; positive definite.
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Identity();
};

/// Where the search for a scan started.
enum class SearchedFrom {
  kEverywhere,     ///< no prior
  kGiven,          ///< the pose of `initialize`
  kVelocity,       ///< the last poses, continued
  kOdometry,       ///< the pose at `since_ns` and the vehicle's odometry
  kInterpolation,  ///< a late scan: the poses before and after it
  kNowhere,        ///< not searched for: too old
};
[[nodiscard]] std::string_view name_of(SearchedFrom from);

/// Answer to one scan of a session.
struct TrackedPose {
  std::int64_t stamp_ns = 0;
  /// As the aligner answered, with what the session adds to `reasons`:
  ///   `coasting`           not matched; pose and covariance are the prediction's,
  ///   `interpolated`       the same for a late scan,
  ///   `contradicts_motion` a match that the motion speaks against; the pose is not the match's
  ///                        but the prediction's, or, while searching, a new place,
  ///   `unconfirmed`        found by a search; no later scan has agreed yet,
  ///   `not_tracked`        nothing predicts the pose any more,
  ///   `too_old`            older than what is kept,
  ///   `clock_set_back`     the fifth such scan in a row, each newer than the one before: what went
  ///                        ahead of it was wrong, and the session has begun anew.
  /// `ok` only for a match that agrees with the motion. The covariance is the match's own; the
  /// session does not make it smaller.
  AlignmentResult result;
  SearchedFrom searched_from = SearchedFrom::kNowhere;
};

class TrackingSession;

/// Follows one vehicle through one map.
///
/// Each scan is looked for around the pose that the last ones predict (constant velocity, or the
/// vehicle's odometry). What contradicts the prediction is not believed. Without a match poses are
/// predicted for a bounded time, then the scan is looked for widely, then everywhere; what such a
/// search finds is `ok` only after the following scans agreed. The state machine is drawn in
/// localization/sessions.md.
/// @note Not safe from several threads: one session is one sequence. Several sessions may share an
/// aligner. Same calls, same bits.
class Tracker {
 public:
  /// @throws std::invalid_argument on broken options or without an aligner.
  explicit Tracker(std::shared_ptr<const Aligner> aligner, const TrackerOptions& options = {});
  ~Tracker();
  Tracker(Tracker&&) noexcept;
  Tracker& operator=(Tracker&&) noexcept;

  /// Forgets everything and looks for the next scan around this pose.
  /// @param covariance  order and frame as in `AlignmentResult`.
  /// @throws std::invalid_argument if the pose is not finite, beyond 1e9 m or not rigid, or the
  ///         covariance not positive definite.
  void initialize(const Eigen::Isometry3d& T_map_lidar,
                  const Eigen::Matrix<double, 6, 6>& covariance);

  /// Answers one scan.
  ///
  /// A scan that is older than the newest is matched around the kept poses of its time and moves
  /// nothing (its odometry is not used); older than those it is lost, `too_old`. A stamp that was
  /// answered is answered the same again, whatever comes with it. After a clock was set back, or a
  /// stamp far ahead, the fifth scan begins anew (`clock_set_back`).
  /// @param stamp_ns    any clock, the same for all scans of the session.
  /// @param scan_lidar  points [m], finite. With `time_offsets_s` they are moved to the stamp by
  ///                    the velocity that is predicted, where it is known within 2 m/s and
  ///                    0.2 rad/s, else as the aligner does it.
  /// @param odometry    where `since_ns` is not a kept pose's stamp, the velocity is used instead;
  ///                    `searched_from` says so.
  /// @throws std::invalid_argument if a number is not finite, there are times but not one a point,
  /// or
  ///         one is 10 s and more, the odometry's motion is not rigid or beyond 1e5 m, its
  ///         covariance not positive definite, or `since_ns` not before `stamp_ns`; then nothing
  ///         has changed.
  [[nodiscard]] TrackedPose track(std::int64_t stamp_ns, const maps::PointCloud& scan_lidar,
                                  const std::optional<OdometryStep>& odometry = std::nullopt);

 private:
  std::unique_ptr<TrackingSession> session_;
};

}  // namespace stillmap::localization
