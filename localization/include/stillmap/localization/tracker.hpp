#pragma once

#include <stillmap/localization/aligner.hpp>
#include <stillmap/localization/options.hpp>
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
  /// As the aligner answered; the session may add reasons (see `Reason`). With `contradicts_motion`
  /// the pose is the prediction's or, while searching, that of the new place. `ok` only for a match
  /// that agrees with the motion. The covariance is the match's own; the session does not make it
  /// smaller.
  AlignmentResult result;
  SearchedFrom searched_from = SearchedFrom::kNowhere;
};

class TrackingSession;

/// Most bytes of `Tracker::state`.
inline constexpr std::size_t kMaxTrackerStateBytes = 1511;

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
  /// The same session twice, each of which goes on by itself.
  Tracker(const Tracker& other);
  Tracker& operator=(const Tracker& other);
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
  /// The same for a scan that was thinned before (`thin`, or the vehicle did). Scans are thinned
  /// first and moved to the stamp then, so both give equal bits.
  [[nodiscard]] TrackedPose track_thin(std::int64_t stamp_ns, const ThinScan& scan_lidar,
                                       const std::optional<OdometryStep>& odometry = std::nullopt);
  /// As the session's aligner thins a scan.
  [[nodiscard]] ThinScan thin(const ScanView& scan_lidar) const;

  /// Stamp of the newest scan that was answered; nothing before the first one.
  [[nodiscard]] std::optional<std::int64_t> newest_ns() const;
  /// The session as bytes, at most `kMaxTrackerStateBytes`. A tracker that is restored from them
  /// answers scans newer than `newest_ns` with the same bits as this one, if both have the same map
  /// and options. The bytes do not hold what other scans need: late ones, those that are sent
  /// again, and odometry from before the newest scan (then the velocity is used instead).
  /// @throws std::logic_error before a scan was answered: there is nothing to go on from.
  [[nodiscard]] std::string state() const;
  /// Goes on where another tracker was. Give it newer scans only.
  /// @throws std::invalid_argument as the constructor; maps::InputError for bytes that are no
  /// state, or of another version of the format. Any bytes may be given; whoever takes them from
  /// somebody else checks that they are unchanged.
  [[nodiscard]] static Tracker restored(std::shared_ptr<const Aligner> aligner,
                                        const TrackerOptions& options, std::string_view state);

  /// Where the vehicle was at the newest scan, as far as the session believes, or as `initialize`
  /// said; nothing while it is looked for everywhere.
  [[nodiscard]] std::optional<Eigen::Isometry3d> believed_T_map_lidar() const;
  /// Whether a scan of this stamp is looked for around a place that is believed: where the motion
  /// or `initialize` says that the vehicle is, or, if it is late, between poses that are kept.
  /// Otherwise it is searched for, widely or everywhere.
  [[nodiscard]] bool knows_place_at(
      std::int64_t stamp_ns, const std::optional<OdometryStep>& odometry = std::nullopt) const;
  /// Looks for the next scan everywhere, as at first. Stamps go on: scans that are not newer stay
  /// late.
  void forget_place();
  /// The same session in another map, where both maps show the place. This one is not changed. A
  /// scan that was answered and is sent again is matched again, in the other map.
  /// @param aligner, options  of the other map.
  /// @param T_other_map  takes points of this map to the other one's frame; rigid.
  /// @param covariance   how far off that may be; added to the covariances of the poses. Order and
  /// frame as in `AlignmentResult`.
  /// @throws std::invalid_argument as the constructor and `initialize`.
  [[nodiscard]] Tracker continued_in(std::shared_ptr<const Aligner> aligner,
                                     const TrackerOptions& options,
                                     const Eigen::Isometry3d& T_other_map,
                                     const Eigen::Matrix<double, 6, 6>& covariance) const;

 private:
  std::unique_ptr<TrackingSession> session_;
};

}  // namespace stillmap::localization
