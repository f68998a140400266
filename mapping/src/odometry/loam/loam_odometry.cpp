#include "odometry/loam/loam_odometry.hpp"

#include "odometry/hidden_scan.hpp"
#include "odometry/loam/loam_covariance.hpp"
#include "odometry/loam/map_match.hpp"
#include "odometry/loam/sweep_match.hpp"
#include "odometry/scan_period.hpp"

#include <stillmap/maps/frames.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

namespace stillmap::mapping {
namespace {

using loam::Feature;
using Vector6 = Eigen::Matrix<double, 6, 1>;

/// Five neighbours are looked for within half a cell; voxels of the map.
constexpr double kEdgeCellM = 1.0;
constexpr double kEdgeVoxelM = 0.2;
constexpr double kPlaneCellM = 2.0;
constexpr double kPlaneVoxelM = 0.4;
/// Features of a sweep that are matched with the map, one a voxel of this size.
constexpr double kMatchedEdgeVoxelM = 0.4;
constexpr double kMatchedPlaneVoxelM = 1.0;
constexpr double kMapRadiusM = loam::kMaxRangeM + 10.0;
/// The map forgets what is far each time the sensor has moved so far.
constexpr double kForgetEachM = 10.0;
/// Rounds of deskewing, looking for neighbours in the map, and matching with them.
constexpr int kMapRounds = 4;
/// Rounds in which the first two sweeps learn their motion from each other.
constexpr int kFirstRounds = 4;
/// Below this share of features on what was seen before there is no match.
constexpr double kMinInliers = 0.25;
/// Turns about the sensor's axis beside the predicted one [rad] that are tried where a match
/// explains less than this share of what matches usually do, and the reach of their first round
/// [m].
constexpr double kInliersOfUsual = 0.8;
constexpr std::array<double, 8> kTurnsRad = {0.15, -0.15, 0.3, -0.3, 0.45, -0.45, 0.6, -0.6};
constexpr double kTurnReachM = 1.0;
/// After so many scans on end that match nothing the map begins anew.
constexpr int kMaxLost = 3;
/// What a prediction may be off by [m]: at first, at least, and in deviations of the last ones, of
/// which the newest has this weight.
constexpr double kFirstOffM = 3.0;
/// The same where the speed at the first scan is told [m].
constexpr double kStartOffM = 0.2;
constexpr double kLeastOffM = 0.3;
constexpr double kOffDeviations = 4.0;
constexpr double kNewest = 0.15;

struct PreparedFeatures : Odometry::Prepared {
  std::int64_t stamp_ns = 0;
  std::string source;
  /// Has no features then.
  bool shell = false;
  loam::Features features;
  /// Thinned ones, for the map.
  std::vector<Feature> edges, planes;
};

struct Last {
  Eigen::Isometry3d T_odom_lidar = Eigen::Isometry3d::Identity();
  Vector6 twist = Vector6::Zero();
};

class LoamOdometry : public Odometry {
 public:
  [[nodiscard]] std::unique_ptr<Prepared> prepare(const maps::Scan& scan) const override;
  void start_with(const Vector6& twist_lidar) override {
    start_twist_ = twist_lidar;
    off2_m2_ = kStartOffM * kStartOffM;
  }
  void turned(const Eigen::Matrix3d& R_before_this) override { turned_ = R_before_this; }
  [[nodiscard]] OdometryPose add(const Prepared& prepared) override;

 private:
  [[nodiscard]] double off_m() const {
    return std::clamp(kOffDeviations * std::sqrt(off2_m2_), kLeastOffM, kFirstOffM);
  }
  /// Since the last scan, by its speed and what a gyroscope tells.
  [[nodiscard]] Eigen::Isometry3d predicted_step(double period_s) const;
  void place(const PreparedFeatures& scan, double period_s, OdometryPose& pose);
  [[nodiscard]] loam::SweepMatch since_last(const PreparedFeatures& scan, double period_s);
  [[nodiscard]] loam::MapMatch refine(const PreparedFeatures& scan, double period_s,
                                      const Eigen::Isometry3d& T_odom_lidar) const;
  void learn(Vector6 deviation, bool matched);
  [[nodiscard]] Eigen::Isometry3d after(const loam::SweepMatch& sweep,
                                        const Eigen::Isometry3d& T_predicted) const;
  /// A sensor may turn faster than its last turn tells: other turns are tried, and one that
  /// explains more takes the place of `sweep` and `match`.
  void search_turns(const PreparedFeatures& scan, double period_s, loam::SweepMatch& sweep,
                    loam::MapMatch& match) const;
  void take(const PreparedFeatures& scan, const OdometryPose& pose);
  void map_first();
  void add_to_map(const loam::Features& features, const Eigen::Isometry3d& T_odom_lidar,
                  const Vector6& twist);

  std::optional<Last> last_;
  std::optional<loam::PreviousSweep> previous_;
  /// See `start_with`.
  std::optional<Vector6> start_twist_;
  /// See `turned`.
  std::optional<Eigen::Matrix3d> turned_;
  /// Without it the first sweep until the next has told how the sensor moved.
  std::optional<loam::Features> first_;
  loam::FeatureMaps map_{{kEdgeCellM, kEdgeVoxelM}, {kPlaneCellM, kPlaneVoxelM}};
  Eigen::Vector3d forgot_at_ = Eigen::Vector3d::Zero();
  ScanPeriod period_;
  /// Mean square of what predictions were off by [m^2], rotations at kLeverM.
  double off2_m2_ = kFirstOffM * kFirstOffM;
  /// Running mean of the shares of features that the map explains.
  double usual_inliers_ = 0.0;
  int lost_ = 0;
  /// Scans on end that were predicted.
  int predicted_ = 0;
};

loam::PreviousSweep searchable(const loam::Features& features, const Vector6& twist) {
  return {loam::RingSearch(loam::at_stamp(features.less_sharp, twist)),
          loam::RingSearch(loam::at_stamp(features.less_flat, twist))};
}

std::unique_ptr<Odometry::Prepared> LoamOdometry::prepare(const maps::Scan& scan) const {
  auto prepared = std::make_unique<PreparedFeatures>();
  prepared->stamp_ns = scan.stamp_ns;
  prepared->source = scan.source;
  prepared->shell = is_shell(scan.cloud.positions);
  if (prepared->shell) return prepared;
  if (!scan.cloud.lidars.empty()) {
    // Rings are those of one lidar, and the reference stands at the origin.
    maps::Scan of_reference = scan;
    of_reference.cloud = scan.cloud.of_lidar(0);
    prepared->features = loam::find_features(of_reference.cloud, loam::find_rings(of_reference));
  } else {
    prepared->features = loam::find_features(scan.cloud, loam::find_rings(scan));
  }
  // Once, instead of each time that they are moved to the stamp.
  loam::turn_to_stamp(prepared->features, scan.cloud.turn.get());
  prepared->edges = loam::thinned(prepared->features.less_sharp, kMatchedEdgeVoxelM);
  prepared->planes = loam::thinned(prepared->features.less_flat, kMatchedPlaneVoxelM);
  return prepared;
}

OdometryPose LoamOdometry::add(const Prepared& prepared) {
  const auto& scan = dynamic_cast<const PreparedFeatures&>(prepared);
  OdometryPose pose;
  // A gap is taken for a jump of the clock, not of the sensor.
  if (const auto step = period_.step_to(scan.stamp_ns, scan.source)) {
    const Vector6 twist_before = last_->twist;
    place(scan, step->is_gap ? period_.usual_s() : step->seconds, pose);
    // In which time the sensor went that far nobody knows.
    if (step->is_gap) pose.twist_lidar = twist_before;
  }
  if (!last_ && start_twist_) pose.twist_lidar = *start_twist_;
  pose.hidden = scan.shell;
  take(scan, pose);
  last_ = Last{pose.T_odom_lidar, pose.twist_lidar};
  turned_.reset();
  return pose;
}

Eigen::Isometry3d LoamOdometry::predicted_step(double period_s) const {
  Vector6 motion = last_->twist * period_s;
  if (turned_) motion.tail<3>() = maps::log_so3(*turned_);
  return maps::exp_se3(motion);
}

loam::SweepMatch LoamOdometry::since_last(const PreparedFeatures& scan, double period_s) {
  loam::SweepMatch match;
  match.T = loam::motion(predicted_step(period_s));
  if (!previous_) return match;
  // The first sweep is skewed by a motion that only the next one tells.
  for (int round = 0; round < (first_ ? kFirstRounds : 1); ++round) {
    match = loam::match_sweep(scan.features, period_s, *previous_, match.T, off_m());
    if (!first_) continue;
    last_->twist = maps::log_se3(loam::isometry(match.T)) / period_s;
    previous_ = searchable(*first_, last_->twist);
  }
  return match;
}

loam::MapMatch LoamOdometry::refine(const PreparedFeatures& scan, double period_s,
                                    const Eigen::Isometry3d& T_odom_lidar) const {
  loam::MapMatch match;
  match.T_odom_lidar = T_odom_lidar;
  for (int round = 0; round < kMapRounds && !match.settled; ++round) {
    const Vector6 twist =
        maps::log_se3(last_->T_odom_lidar.inverse() * match.T_odom_lidar) / period_s;
    match = loam::match_map(loam::at_stamp(scan.edges, twist), loam::at_stamp(scan.planes, twist),
                            map_, match);
  }
  return match;
}

Eigen::Isometry3d LoamOdometry::after(const loam::SweepMatch& sweep,
                                      const Eigen::Isometry3d& T_predicted) const {
  if (!(sweep.inlier_ratio >= kMinInliers)) return T_predicted;
  return maps::renormalized(last_->T_odom_lidar * loam::isometry(sweep.T));
}

void LoamOdometry::search_turns(const PreparedFeatures& scan, double period_s,
                                loam::SweepMatch& sweep, loam::MapMatch& match) const {
  if (!previous_ || scan.planes.empty()) return;
  const Eigen::Isometry3d T_step = predicted_step(period_s);
  for (const double turn_rad : kTurnsRad) {
    Eigen::Isometry3d T_start = T_step;
    T_start.rotate(Eigen::AngleAxisd(turn_rad, Eigen::Vector3d::UnitZ()));
    const loam::SweepMatch tried =
        loam::match_sweep(scan.features, period_s, *previous_, loam::motion(T_start), kTurnReachM);
    if (!(tried.inlier_ratio >= kMinInliers)) continue;
    const loam::MapMatch found = refine(scan, period_s, after(tried, last_->T_odom_lidar));
    if (!(found.inlier_ratio > match.inlier_ratio)) continue;
    sweep = tried;
    match = found;
  }
}

void LoamOdometry::place(const PreparedFeatures& scan, double period_s, OdometryPose& pose) {
  const Eigen::Isometry3d T_predicted =
      maps::renormalized(last_->T_odom_lidar * predicted_step(period_s));
  loam::SweepMatch sweep = since_last(scan, period_s);
  map_first();
  loam::MapMatch match = refine(scan, period_s, after(sweep, T_predicted));
  if (match.inlier_ratio < kInliersOfUsual * usual_inliers_) {
    search_turns(scan, period_s, sweep, match);
  }
  const bool swept = sweep.inlier_ratio >= kMinInliers;
  const bool mapped = match.inlier_ratio >= kMinInliers;
  pose.T_odom_lidar = after(sweep, T_predicted);
  pose.inlier_ratio = std::max(match.inlier_ratio, swept ? sweep.inlier_ratio : 0.0);
  if (mapped) {
    pose.T_odom_lidar = match.T_odom_lidar;
    if (match.told) pose.degenerate_directions = match.told->untold;
  } else if (swept) {
    pose.degenerate_directions = sweep.untold;
  }
  if (mapped) {
    const double weight = usual_inliers_ > 0.0 ? kNewest : 1.0;
    usual_inliers_ += weight * (match.inlier_ratio - usual_inliers_);
  }
  if (mapped || swept) {
    pose.status =
        pose.degenerate_directions.empty() ? OdometryStatus::kMatched : OdometryStatus::kPartly;
  }
  learn(maps::log_se3(T_predicted.inverse() * pose.T_odom_lidar), mapped || swept);
  lost_ = mapped || swept || scan.planes.empty() ? 0 : lost_ + 1;
  predicted_ = mapped || swept ? 0 : predicted_ + 1;
  pose.covariance = loam::covariance_of(mapped ? &match : nullptr, period_s, predicted_);
  pose.twist_lidar = maps::log_se3(last_->T_odom_lidar.inverse() * pose.T_odom_lidar) / period_s;
}

void LoamOdometry::learn(Vector6 deviation, bool matched) {
  deviation.tail<3>() *= kLeverM;
  const double squared = matched ? deviation.squaredNorm() : kFirstOffM * kFirstOffM;
  off2_m2_ += (matched ? kNewest : 1.0) * (squared - off2_m2_);
}

void LoamOdometry::take(const PreparedFeatures& scan, const OdometryPose& pose) {
  if (scan.features.less_flat.empty()) {
    // The sweep before is two periods old for the next one: the map alone matches that.
    previous_.reset();
    return;
  }
  previous_ = searchable(scan.features, pose.twist_lidar);
  if (!last_ && !start_twist_) {
    first_ = scan.features;
    return;
  }
  if (lost_ > kMaxLost) {
    map_.edges.clear();
    map_.planes.clear();
    lost_ = 0;
  } else if (lost_ > 0) {
    return;
  }
  add_to_map(scan.features, pose.T_odom_lidar, pose.twist_lidar);
}

void LoamOdometry::map_first() {
  if (!first_) return;
  add_to_map(*first_, last_->T_odom_lidar, last_->twist);
  first_.reset();
}

void LoamOdometry::add_to_map(const loam::Features& features, const Eigen::Isometry3d& T_odom_lidar,
                              const Vector6& twist) {
  const auto add = [&](const std::vector<Feature>& from, loam::FeatureMap& to) {
    for (const Feature& f : loam::at_stamp(from, twist)) {
      to.add(T_odom_lidar * f.position.cast<double>());
    }
  };
  add(features.less_sharp, map_.edges);
  add(features.less_flat, map_.planes);
  const Eigen::Vector3d here = T_odom_lidar.translation();
  if (!((here - forgot_at_).norm() > kForgetEachM)) return;
  map_.edges.keep_around(here, kMapRadiusM);
  map_.planes.keep_around(here, kMapRadiusM);
  forgot_at_ = here;
}

}  // namespace

std::unique_ptr<Odometry> make_loam() { return std::make_unique<LoamOdometry>(); }

}  // namespace stillmap::mapping
