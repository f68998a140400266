#pragma once

#include "odometry/direct/lost_directions.hpp"
#include "odometry/direct/seen_again.hpp"
#include "odometry/direct/thinned_scan.hpp"
#include "odometry/direct/usual_match.hpp"
#include "odometry/scan_period.hpp"

#include <stillmap/localization/local_map.hpp>
#include <stillmap/mapping/odometry.hpp>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

namespace stillmap::mapping {

/// Follows a sensor through one map.
class DirectFollower {
 public:
  using LocalAlignment = localization::LocalAlignment;
  using Vector6d = Eigen::Matrix<double, 6, 1>;

  /// Fewer points of a scan tell nothing.
  static constexpr std::size_t kMinPoints = 100;

  DirectFollower() = default;
  /// @param T_odom_first  where the first scan was taken.
  explicit DirectFollower(const Eigen::Isometry3d& T_odom_first) : T_odom_first_(T_odom_first) {}

  void start_with(const Vector6d& twist_lidar);
  void expect(const Eigen::Isometry3d& T_before_this) { expected_ = T_before_this; }
  void turned(const Eigen::Matrix3d& R_before_this) { turned_ = R_before_this; }
  [[nodiscard]] OdometryPose add(const ThinnedScan& scan);
  /// Whether the last scan lay on surfaces.
  [[nodiscard]] bool on_surfaces() const { return usual_.on_surfaces(); }

 private:
  using Matrix6d = Eigen::Matrix<double, 6, 6>;

  /// Deviation of speeds before any was seen [m/s].
  static constexpr double kUnknownOffRate = 3.0;
  /// The same where the speed at the first scan is told [m/s].
  static constexpr double kStartOffRate = 1.5;

  struct Last {
    Eigen::Isometry3d T_odom_lidar = Eigen::Isometry3d::Identity();
    Vector6d twist = Vector6d::Zero();
  };
  /// Where a scan is looked for, how far off that may be, and how the sensor moved meanwhile.
  struct Prediction {
    Eigen::Isometry3d T_odom_lidar;
    double off_m;
    Vector6d twist;
  };
  /// Where the points of a scan lie, and how sure that is.
  struct Found {
    Eigen::Isometry3d T_odom_lidar;
    LocalAlignment match;
  };
  /// Aligns from a start, deskewed by `twist` at first and by the motion that is found then.
  [[nodiscard]] Found aligned(const ThinnedScan& scan, const Vector6d& twist,
                              const Eigen::Isometry3d& T_start, double off_m,
                              const ScanPeriod::Step& step) const;
  [[nodiscard]] Found searched(const ThinnedScan& scan, const Vector6d& twist,
                               const Eigen::Isometry3d& T_start,
                               const ScanPeriod::Step& step) const;
  [[nodiscard]] Found best_of_widening(const ThinnedScan& scan, const Prediction& prediction,
                                       const ScanPeriod::Step& step) const;
  /// Motion of the sensor since the last scan that was not hidden as a rate; as it was, over a gap.
  [[nodiscard]] Vector6d twist_to(const Eigen::Isometry3d& T_odom_lidar,
                                  const ScanPeriod::Step& step) const;
  /// Where the speed leads in so long, with the turn that a gyroscope tells.
  [[nodiscard]] Prediction by_speed(double seconds, double step_s) const;
  /// Where the sensor is said to have moved.
  [[nodiscard]] std::optional<Prediction> as_expected(const ScanPeriod::Step& step) const;
  [[nodiscard]] double off_after(double seconds, double off_rate2) const;
  /// Whether it sees the surroundings of the last scan that was not hidden; nothing where there are
  /// too few to tell.
  [[nodiscard]] std::optional<bool> sees_again(const ThinnedScan& scan,
                                               const Eigen::Isometry3d& T_odom_lidar,
                                               const Vector6d& twist) const;
  [[nodiscard]] bool is_covered(const ThinnedScan& scan, const Prediction& prediction) const;
  [[nodiscard]] bool is_frame_again(const ThinnedScan& scan, const Prediction& prediction) const;
  [[nodiscard]] bool is_hidden(const ThinnedScan& scan, const Found& found,
                               const ScanPeriod::Step& step) const;
  void keep_as_hidden(const ScanPeriod::Step& step, OdometryPose& pose);
  void place(const ThinnedScan& scan, const ScanPeriod::Step& step, OdometryPose& pose);
  [[nodiscard]] Found found_over(const ThinnedScan& scan, const ScanPeriod::Step& step,
                                 Prediction& prediction) const;
  [[nodiscard]] Prediction predicted(const std::optional<Prediction>& expected,
                                     const ScanPeriod::Step& step) const;
  [[nodiscard]] bool is_denied(const Found& found, const Prediction& expected,
                               const ThinnedScan& scan, const ScanPeriod::Step& step) const;
  void start_anew(const ThinnedScan& first, const ThinnedScan& scan, const ScanPeriod::Step& step);
  /// @param off_rate2  of what predicted so, see `off_rate2_`.
  void learn(const Vector6d& deviation, double dt_s, double& off_rate2) const;
  /// Of where a prediction ends after so long without a word, along any direction [m^2].
  [[nodiscard]] double variance_after_m2(double t_s) const;
  /// Of one step: what it adds to the variance since all was told, so that the steps' own add up
  /// to that of the whole stretch although one wrong speed is in all of them.
  [[nodiscard]] Matrix6d covariance_of_prediction(double dt_s) const;
  void take(const ThinnedScan& scan, const OdometryPose& pose);

  localization::LocalMap map_;
  ScanPeriod period_;
  /// Of the scan before, once there is one.
  Last last_;
  Eigen::Isometry3d T_odom_first_ = Eigen::Isometry3d::Identity();
  /// Pose of the last visible scan.
  Eigen::Isometry3d T_odom_seen_ = Eigen::Isometry3d::Identity();
  /// Time hidden since then [s].
  double hidden_s_ = 0.0;
  /// Points of that scan.
  SeenAgain seen_;
  /// `ThinnedScan::content` of the scan before.
  std::uint64_t last_content_ = 0;
  std::optional<Eigen::Isometry3d> T_odom_mapped_;
  std::size_t scans_in_map_ = 0;
  /// Mean square of how fast predictions went astray [m^2/s^2].
  double off_rate2_ = kUnknownOffRate * kUnknownOffRate;
  /// See `expect`, and the mean square of how fast that went astray.
  std::optional<Eigen::Isometry3d> expected_;
  double expected_off_rate2_ = kStartOffRate * kStartOffRate;
  /// See `turned`.
  std::optional<Eigen::Matrix3d> turned_;
  /// How long some direction has not been told.
  double untold_s_ = 0.0;
  LostDirections directions_;
  UsualMatch usual_;
  /// See `start_with`.
  std::optional<Vector6d> start_twist_;
  /// Without it the first scan, until the second tells how the sensor moved meanwhile.
  std::optional<ThinnedScan> first_;
};

}  // namespace stillmap::mapping
