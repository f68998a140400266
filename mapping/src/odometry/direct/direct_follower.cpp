#include "odometry/direct/direct_follower.hpp"

#include "odometry/direct/directions.hpp"
#include "odometry/lever.hpp"

#include <stillmap/maps/deskew.hpp>
#include <stillmap/maps/frames.hpp>

#include <algorithm>
#include <cmath>
#include <utility>

namespace stillmap::mapping {
namespace {

using localization::LocalMap;
using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

/// Least and most that a prediction counts as off [m].
constexpr double kLeastMissM = 0.12;
constexpr double kMostOffM = 3.0;
/// How far a place that was searched for may be off [m].
constexpr double kSearchedOffM = 0.6;
/// Deviations that the search reaches.
constexpr double kMissDeviations = 3.0;
/// Sharp turns between two scans: with what the search reaches to either side, up to 57 degrees.
constexpr double kSuddenTurnRad = 0.6;
/// The map takes a scan when the sensor has moved so far, or turned so much, since the last one.
constexpr double kMapStepM = 0.5;
constexpr double kMapStepRad = 0.05;
/// At first the map takes all, so that it gets shapes.
constexpr std::size_t kFirstScans = 10;
/// Deviation of the acceleration that nothing tells [m/s^2].
constexpr double kUntoldAcceleration = 0.5;
/// The same through hidden scans, where vehicles brake and turn as anywhere.
constexpr double kHiddenAcceleration = 2.0;
/// A scan is hidden, too, when it sees less than this share of what the scan before saw again: in
/// clean drives it is 0.73 and more, with shells 0.15 and less.
constexpr double kHiddenSeenAgain = 0.35;
/// The refined pose is taken if its fit is at least this share of the coarse one.
constexpr double kRefinedFit = 0.98;
/// An identical scan counts as sent twice only if the prediction moved more than this.
constexpr double kStuckMoveM = 0.02;

std::vector<Eigen::Vector3f> deskewed(maps::PointCloud cloud, const Vector6d& twist) {
  maps::deskew(cloud, twist);
  return std::move(cloud.positions);
}

}  // namespace

void DirectFollower::start_with(const Vector6d& twist_lidar) {
  start_twist_ = twist_lidar;
  directions_.start_with(twist_lidar);
  off_rate2_ = kStartOffRate * kStartOffRate;
}

OdometryPose DirectFollower::add(const ThinnedScan& scan) {
  OdometryPose pose;
  const auto step = period_.step_to(scan.stamp_ns, scan.source);
  if (step) {
    place(scan, *step, pose);
  } else {
    pose.T_odom_lidar = T_odom_first_;
    pose.hidden = scan.shell;
    if (start_twist_) pose.twist_lidar = *start_twist_;
  }
  if (!pose.hidden) {
    if (!start_twist_ && scans_in_map_ == 0 && scan.dense.size() >= kMinPoints) first_ = scan;
    take(scan, pose);
    hidden_s_ = 0.0;
    T_odom_seen_ = pose.T_odom_lidar;
    if (scan.sparse.size() >= kMinPoints)
      seen_.remember(deskewed(scan.sparse, pose.twist_lidar), pose.T_odom_lidar);
  }
  last_ = Last{pose.T_odom_lidar, pose.twist_lidar};
  expected_.reset();
  turned_.reset();
  last_content_ = scan.content;
  return pose;
}

Vector6d DirectFollower::twist_to(const Eigen::Isometry3d& T_odom_lidar,
                                  const ScanPeriod::Step& step) const {
  if (step.is_gap) return last_.twist;
  if (hidden_s_ > 0.0)
    return maps::log_se3(T_odom_seen_.inverse() * T_odom_lidar) / (hidden_s_ + step.seconds);
  return maps::log_se3(last_.T_odom_lidar.inverse() * T_odom_lidar) / step.seconds;
}

DirectFollower::Prediction DirectFollower::by_speed(double seconds, double step_s) const {
  Vector6d motion = last_.twist * std::min(seconds, ScanPeriod::kMaxGapS);
  Vector6d twist = last_.twist;
  if (turned_) {
    motion.tail<3>() = maps::log_so3(*turned_);
    twist.tail<3>() = motion.tail<3>() / step_s;
  }
  return {maps::renormalized(last_.T_odom_lidar * maps::exp_se3(motion)),
          off_after(step_s + hidden_s_, off_rate2_), twist};
}

std::optional<DirectFollower::Prediction> DirectFollower::as_expected(
    const ScanPeriod::Step& step) const {
  if (!expected_) return std::nullopt;
  const Eigen::Isometry3d T = maps::renormalized(last_.T_odom_lidar * *expected_);
  return Prediction{T, off_after(step.seconds + hidden_s_, expected_off_rate2_), twist_to(T, step)};
}

double DirectFollower::off_after(double seconds, double off_rate2) const {
  const double hidden_m = kHiddenAcceleration * hidden_s_ * hidden_s_;
  return std::clamp(kLeastMissM + kMissDeviations * std::sqrt(off_rate2) * seconds + hidden_m,
                    kLeastMissM, kMostOffM);
}

double DirectFollower::variance_after_m2(double t_s) const {
  const double acceleration = hidden_s_ > 0.0 ? kHiddenAcceleration : kUntoldAcceleration;
  const double by_acceleration_m = 0.5 * acceleration * t_s * t_s;
  return off_rate2_ * t_s * t_s + by_acceleration_m * by_acceleration_m;
}

Matrix6d DirectFollower::covariance_of_prediction(double dt_s) const {
  const double t_s = std::min(dt_s, ScanPeriod::kMaxGapS);
  const double variance_m2 = kLeastMissM * kLeastMissM / 9.0 + variance_after_m2(untold_s_ + t_s) -
                             variance_after_m2(untold_s_);
  return rotations_times(variance_m2 * Matrix6d::Identity(), 1.0 / kLeverM);
}

DirectFollower::Found DirectFollower::aligned(const ThinnedScan& scan, const Vector6d& twist,
                                              const Eigen::Isometry3d& T_start, double off_m,
                                              const ScanPeriod::Step& step) const {
  std::vector<Eigen::Vector3f> points = deskewed(scan.sparse, twist);
  Eigen::Isometry3d T = map_.refined(points, T_start, off_m);
  if (!scan.sparse.time_offsets_s.empty()) {
    points = deskewed(scan.sparse, twist_to(T, step));
    T = map_.refined(points, T, kLeastMissM);
  }
  return {T, map_.judged(points, T)};
}

DirectFollower::Found DirectFollower::searched(const ThinnedScan& scan, const Vector6d& twist,
                                               const Eigen::Isometry3d& T_start,
                                               const ScanPeriod::Step& step) const {
  const Eigen::Isometry3d T = map_.searched(deskewed(scan.sparse, twist), T_start);
  return aligned(scan, twist, T, kSearchedOffM, step);
}

/// Wide kernels on coarse voxels lead sparse scans astray, narrow ones do not see far: the narrow
/// try comes first, and is enough when it explains as much as usual.
DirectFollower::Found DirectFollower::best_of_widening(const ThinnedScan& scan,
                                                       const Prediction& prediction,
                                                       const ScanPeriod::Step& step) const {
  const auto& [T_predicted, off_m, twist] = prediction;
  Found best = aligned(scan, twist, T_predicted, std::min(off_m, kSearchedOffM), step);
  const bool follows = usual_.matched() > kFirstScans || start_twist_ || expected_;
  if (follows && off_m <= kSearchedOffM && usual_.explains(best.match)) return best;
  const auto try_too = [&](Found found) {
    if (found.match.fit > best.match.fit) best = std::move(found);
  };
  try_too(aligned(scan, twist, T_predicted, kMostOffM, step));
  try_too(searched(scan, twist, T_predicted, step));
  if (usual_.matched() <= kFirstScans || usual_.explains(best.match)) return best;
  for (const double turn_rad : {-kSuddenTurnRad, kSuddenTurnRad}) {
    Eigen::Isometry3d T_turned = T_predicted;
    T_turned.rotate(Eigen::AngleAxisd(turn_rad, Eigen::Vector3d::UnitZ()));
    try_too(searched(scan, twist, T_turned, step));
  }
  return best;
}

/// The first scan could not be deskewed. With the same skew in both the motion from it to the
/// second is nearly right, which deskews both.
void DirectFollower::start_anew(const ThinnedScan& first, const ThinnedScan& scan,
                                const ScanPeriod::Step& step) {
  Eigen::Isometry3d T = last_.T_odom_lidar;
  T = map_.searched(scan.sparse.positions, T);
  T = map_.refined(scan.sparse.positions, T, kSearchedOffM);
  for (int round = 0; round < (first.dense.time_offsets_s.empty() ? 0 : 2); ++round) {
    map_ = LocalMap();
    map_.add(deskewed(first.dense, twist_to(T, step)), T_odom_seen_);
    T = map_.refined(deskewed(scan.sparse, twist_to(T, step)), T, kSearchedOffM);
  }
  last_.twist = twist_to(T, step);
}

/// Where the scan lies from what is predicted. @param prediction  for this step; becomes that from
/// which this fits better.
DirectFollower::Found DirectFollower::found_over(const ThinnedScan& scan,
                                                 const ScanPeriod::Step& step,
                                                 Prediction& prediction) const {
  Found found = best_of_widening(scan, prediction, step);
  const auto try_too = [&](const Prediction& other) {
    Found from_other = best_of_widening(scan, other, step);
    if (!(from_other.match.fit > found.match.fit)) return;
    found = std::move(from_other);
    prediction = other;
  };
  // Where the clock alone has jumped, the sensor has gone on as ever.
  if (step.is_gap) try_too(by_speed(period_.usual_s(), step.seconds));
  // Given poses jump at times, and speeds change.
  if (expected_ && usual_.matched() > kFirstScans && !usual_.explains(found.match)) {
    const Prediction speed = by_speed(step.seconds, step.seconds);
    const bool tried_speed = prediction.T_odom_lidar.isApprox(speed.T_odom_lidar, 0.0);
    try_too(tried_speed ? *as_expected(step) : speed);
  }
  // After a gap, refine once more with narrow kernels: wide ones stop early.
  if (hidden_s_ > 0.0) {
    const Vector6d twist = twist_to(found.T_odom_lidar, step);
    Found refined = aligned(scan, twist, found.T_odom_lidar, kLeastMissM, step);
    if (refined.match.fit >= kRefinedFit * found.match.fit) found = std::move(refined);
  }
  return found;
}

/// Whether a match far from what is expected is none: sparse scans of a bare street agree with
/// many places along it, and best with where their own rings lie as before. What is expected is
/// right then, and explains the scan nearly as well; after a jump of given poses it does not.
bool DirectFollower::is_denied(const Found& found, const Prediction& expected,
                               const ThinnedScan& scan, const ScanPeriod::Step& step) const {
  const double off_m =
      (found.T_odom_lidar.translation() - expected.T_odom_lidar.translation()).norm();
  if (off_m <= std::max(expected.off_m, kSearchedOffM)) return false;
  // Where the speed has led for a while is no chance; poses that stand still are a receiver's.
  const Prediction speed = by_speed(step.seconds, step.seconds);
  const double off_speed_m =
      (found.T_odom_lidar.translation() - speed.T_odom_lidar.translation()).norm();
  if (usual_.matched() > kFirstScans && off_speed_m <= kSearchedOffM) return false;
  const std::vector<Eigen::Vector3f> points = deskewed(scan.sparse, expected.twist);
  const LocalAlignment there = map_.judged(points, expected.T_odom_lidar);
  return there.known_inlier_ratio >= UsualMatch::kKnown * found.match.known_inlier_ratio &&
         there.standing_ratio >= UsualMatch::kStanding * found.match.standing_ratio;
}

/// By what was nearer lately. At first by the speed, which is that of several scans, unless it is
/// far from what is expected: then it is that of a match as in `is_denied`.
DirectFollower::Prediction DirectFollower::predicted(const std::optional<Prediction>& expected,
                                                     const ScanPeriod::Step& step) const {
  Prediction speed = by_speed(step.seconds, step.seconds);
  if (!expected) return speed;
  const double apart_m =
      (speed.T_odom_lidar.translation() - expected->T_odom_lidar.translation()).norm();
  const bool is_first = usual_.matched() <= kFirstScans && apart_m > kSearchedOffM;
  return is_first || expected_off_rate2_ < off_rate2_ ? *expected : speed;
}

/// Whether it is the scan before once more, and the sensor has moved since.
bool DirectFollower::is_frame_again(const ThinnedScan& scan, const Prediction& prediction) const {
  if (scan.content == 0 || scan.content != last_content_) return false;
  const Eigen::Isometry3d moved = last_.T_odom_lidar.inverse() * prediction.T_odom_lidar;
  return in_metres(maps::log_se3(moved)).norm() > kStuckMoveM;
}

std::optional<bool> DirectFollower::sees_again(const ThinnedScan& scan,
                                               const Eigen::Isometry3d& T_odom_lidar,
                                               const Vector6d& twist) const {
  const auto share = seen_.share(deskewed(scan.sparse, twist), T_odom_lidar);
  return share ? std::optional(*share >= kHiddenSeenAgain) : std::nullopt;
}

/// A shell, unless what it is of was seen before, as the walls of a round room are.
bool DirectFollower::is_covered(const ThinnedScan& scan, const Prediction& prediction) const {
  return scan.shell && !sees_again(scan, prediction.T_odom_lidar, prediction.twist).value_or(false);
}

/// True if even the best match does not explain the scan: it does not lie on the map where that
/// knows something, or shows nothing of what the one before saw.
bool DirectFollower::is_hidden(const ThinnedScan& scan, const Found& found,
                               const ScanPeriod::Step& step) const {
  if (!usual_.is_likely(found.match)) return true;
  const Vector6d twist = twist_to(found.T_odom_lidar, step);
  return !sees_again(scan, found.T_odom_lidar, twist).value_or(true);
}

/// The scan keeps its predicted pose and is not added to the map.
void DirectFollower::keep_as_hidden(const ScanPeriod::Step& step, OdometryPose& pose) {
  const double t_s = std::min(step.seconds, ScanPeriod::kMaxGapS);
  hidden_s_ += t_s;
  pose.covariance = covariance_of_prediction(step.seconds);
  untold_s_ += t_s;
  pose.hidden = true;
}

void DirectFollower::place(const ThinnedScan& scan, const ScanPeriod::Step& step,
                           OdometryPose& pose) {
  const bool enough = scan.sparse.size() >= kMinPoints && map_.voxel_count() > 0;
  const Prediction at_first = predicted(as_expected(step), step);
  const bool covered = is_covered(scan, at_first) || is_frame_again(scan, at_first);
  const Last before = last_;
  const bool is_second = first_ && enough && !covered;
  if (is_second) start_anew(*first_, scan, step);
  const std::optional<Prediction> expected = as_expected(step);
  Prediction prediction = predicted(expected, step);
  pose.T_odom_lidar = prediction.T_odom_lidar;
  pose.twist_lidar = prediction.twist;
  pose.covariance = covariance_of_prediction(step.seconds);
  const double untold_s = untold_s_ + std::min(step.seconds, ScanPeriod::kMaxGapS);
  if (covered) return keep_as_hidden(step, pose);
  if (!enough) {
    untold_s_ = untold_s;
    return;
  }
  const Found found = found_over(scan, step, prediction);
  const LocalAlignment& match = found.match;
  pose.inlier_ratio = match.inlier_ratio;
  if (is_hidden(scan, found, step)) {
    if (is_second) {
      // Undo start_anew: this scan says nothing about the first one's motion.
      map_ = LocalMap();
      map_.add(first_->dense.positions, T_odom_seen_);
      last_ = before;
      prediction = predicted(as_expected(step), step);
      pose.T_odom_lidar = prediction.T_odom_lidar;
      pose.twist_lidar = prediction.twist;
    }
    return keep_as_hidden(step, pose);
  }
  first_.reset();
  const bool matches = match.matched >= LocalAlignment::kMinMatched &&
                       match.known_inlier_ratio >= UsualMatch::kLeastInliers;
  if (expected && matches && is_denied(found, *expected, scan, step)) {
    pose.T_odom_lidar = expected->T_odom_lidar;
    pose.twist_lidar = expected->twist;
    untold_s_ = untold_s;
    return;
  }
  if (!matches) {
    untold_s_ = untold_s;
    return;
  }
  const bool was_lost = directions_.has_any();
  const std::vector<Vector6d> kept = directions_.untold(match, expected_.has_value());
  pose.degenerate_directions = kept.empty() ? match.degenerate_directions : kept;
  if (!was_lost && directions_.has_any()) {
    last_.twist = directions_.steadied(last_.twist);
    prediction = predicted(expected, step);
  }
  const auto deviation_from = [&](const Prediction& from) {
    return without(maps::log_se3(from.T_odom_lidar.inverse() * found.T_odom_lidar), kept);
  };
  const Vector6d deviation = deviation_from(prediction);
  pose.covariance = with_predicted(match.covariance, pose.degenerate_directions,
                                   covariance_of_prediction(step.seconds));
  const bool all_told = pose.degenerate_directions.empty();
  pose.status = all_told ? OdometryStatus::kMatched : OdometryStatus::kPartly;
  pose.T_odom_lidar = kept.empty()
                          ? found.T_odom_lidar
                          : maps::renormalized(prediction.T_odom_lidar * maps::exp_se3(deviation));
  untold_s_ = all_told ? 0.0 : untold_s;
  pose.twist_lidar = twist_to(pose.T_odom_lidar, step);
  if (all_told) directions_.learn(pose.twist_lidar);
  const double predicted_s = step.seconds + hidden_s_;
  if (!step.is_gap)
    learn(deviation_from(by_speed(step.seconds, step.seconds)), predicted_s, off_rate2_);
  if (expected) learn(deviation_from(*expected), predicted_s, expected_off_rate2_);
  usual_.learn(match);
}

void DirectFollower::learn(const Vector6d& deviation, double dt_s, double& off_rate2) const {
  const double rate = in_metres(deviation).norm() / dt_s;
  // What is not told may be off by more.
  if (directions_.has_any() && rate * rate < off_rate2) return;
  off_rate2 += UsualMatch::kNewestShare * (rate * rate - off_rate2);
}

void DirectFollower::take(const ThinnedScan& scan, const OdometryPose& pose) {
  if (scan.dense.size() < kMinPoints) return;
  if (T_odom_mapped_ && scans_in_map_ >= kFirstScans) {
    const Eigen::Isometry3d moved = T_odom_mapped_->inverse() * pose.T_odom_lidar;
    if (moved.translation().norm() < kMapStepM &&
        maps::rotation_angle_rad(moved.linear()) < kMapStepRad) {
      return;
    }
  }
  map_.add(deskewed(scan.dense, pose.twist_lidar), pose.T_odom_lidar);
  T_odom_mapped_ = pose.T_odom_lidar;
  ++scans_in_map_;
}

}  // namespace stillmap::mapping
