#include "odometry/direct/direct_odometry.hpp"

#include "odometry/direct/seen_again.hpp"
#include "odometry/direct/thinned_scan.hpp"
#include "odometry/lever.hpp"
#include "odometry/scan_period.hpp"

#include <stillmap/localization/local_map.hpp>
#include <stillmap/maps/deskew.hpp>
#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/median.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <utility>

namespace stillmap::mapping {
namespace {

using localization::LocalAlignment;
using localization::LocalMap;
using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

/// Fewer points of a scan tell nothing.
constexpr std::size_t kMinPoints = 100;
/// Least and most that a prediction counts as off [m].
constexpr double kLeastMissM = 0.12;
constexpr double kMostOffM = 3.0;
/// How far a place that was searched for may be off [m].
constexpr double kSearchedOffM = 0.6;
/// Deviations that the search reaches.
constexpr double kMissDeviations = 3.0;
/// Weight of the newest deviation in their mean square.
constexpr double kNewestShare = 0.15;
/// Deviation of speeds before any was seen [m/s].
constexpr double kUnknownOffRate = 3.0;
/// The same where the speed at the first scan is told [m/s].
constexpr double kStartOffRate = 1.5;
/// A match is doubted, and looked for farther away, when of the points that fall where the map
/// knows anything less than this share of the usual lie on it, or of those that stand above the
/// ground. Wrong places explain 0.75 to 0.9 of the usual, since ground fits nearly everywhere.
constexpr double kKnownOfUsual = 0.93;
constexpr double kStandingOfUsual = 0.8;
/// Sharp turns between two scans: with what the search reaches to either side, up to 57 degrees.
constexpr double kSuddenTurnRad = 0.6;
/// Below it there is no match.
constexpr double kLeastInliers = 0.45;
/// The map takes a scan when the sensor has moved so far, or turned so much, since the last one.
constexpr double kMapStepM = 0.5;
constexpr double kMapStepRad = 0.05;
/// At first the map takes all, so that it gets shapes.
constexpr std::size_t kFirstScans = 10;
/// A direction that was lost is told again once so many scans in a row say so.
constexpr std::size_t kToldAgainScans = 3;
/// Along a direction that gets lost the speed stays the median of as many scans that told it: the
/// last one sees little, and by a wrong speed of it all that follow would go astray.
constexpr std::size_t kSteadyScans = 5;
/// Deviation of the acceleration that nothing tells [m/s^2].
constexpr double kUntoldAcceleration = 0.5;
/// The same through hidden scans, where vehicles brake and turn as anywhere.
constexpr double kHiddenAcceleration = 2.0;
/// With fewer matched scans the map is too thin for these tests: half of a sparse sensor's second
/// scan falls on no voxel.
constexpr std::size_t kThinScans = 3;
/// A scan is hidden when less than this share of the usual of its points lie on the map, of those
/// that fall where the map knows anything: in clean drives it is 0.78 and more (0.9 once there is a
/// map), of dust and shells 0.3 to 0.55.
constexpr double kHiddenOfUsual = 0.65;
/// Or when its fit, and in the geometric mean of both also those of its points that stand and lie
/// on the map, are less than these shares of the usual. The mean is 0.36 and more, also where a
/// sparse sensor that turns misses a scan; of dust 0.26 and less.
constexpr double kHiddenFitOfUsual = 0.6;
constexpr double kHiddenMeanOfUsual = 0.3;
/// Or when it sees less than this share of what the scan before saw again: in clean drives 0.73 and
/// more, with shells 0.15 and less.
constexpr double kHiddenSeenAgain = 0.35;
/// This is not asked where less than this share of what stands usually lies on the map.
constexpr double kStandingTells = 0.3;
/// On surfaces points fit, as a share of those that lie there, better than this: 0.58 and more. In
/// dust the map has cells full of points and no surfaces: 0.35 and less.
constexpr double kFitOfInliers = 0.5;
/// The refined pose is taken if its fit is at least this share of the coarse one.
constexpr double kRefinedFit = 0.98;
/// An identical scan counts as sent twice only if the prediction moved more than this.
constexpr double kStuckMoveM = 0.02;
/// After this many hidden scans in a row that match the map of the one before them, odometry
/// restarts with that map.
constexpr std::size_t kAnewScans = 5;

/// Of each component.
Vector6d median_of(const std::deque<Vector6d>& twists) {
  Vector6d median;
  for (Eigen::Index k = 0; k < 6; ++k) {
    std::vector<double> values;
    for (const Vector6d& twist : twists) values.push_back(twist[k]);
    median[k] = maps::median(std::move(values));
  }
  return median;
}

/// What is left of a motion without its parts along some directions.
Vector6d without(const Vector6d& motion, const std::vector<Vector6d>& directions) {
  Vector6d left = in_metres(motion);
  for (const Vector6d& direction : directions) left -= direction.dot(left) * direction;
  left.tail<3>() /= kLeverM;
  return left;
}

/// Covariance of a match, but along some directions that of the prediction.
Matrix6d with_predicted(const Matrix6d& match, const std::vector<Vector6d>& directions,
                        const Matrix6d& prediction) {
  Matrix6d kept = Matrix6d::Identity();
  for (const Vector6d& direction : directions) kept -= direction * direction.transpose();
  const Matrix6d rest = Matrix6d::Identity() - kept;
  const Matrix6d in_m = kept * rotations_times(match, kLeverM) * kept +
                        rest * rotations_times(prediction, kLeverM) * rest;
  return rotations_times(0.5 * (in_m + in_m.transpose()), 1.0 / kLeverM);
}

/// Follows a sensor through one map.
class DirectFollower {
 public:
  DirectFollower() = default;
  /// @param T_odom_first  where the first scan was taken.
  explicit DirectFollower(const Eigen::Isometry3d& T_odom_first) : T_odom_first_(T_odom_first) {}

  void start_with(const Vector6d& twist_lidar) {
    start_twist_ = twist_lidar;
    steady_.assign(kSteadyScans, twist_lidar);
    off_rate2_ = kStartOffRate * kStartOffRate;
  }
  void expect(const Eigen::Isometry3d& T_before_this) { expected_ = T_before_this; }
  [[nodiscard]] OdometryPose add(const ThinnedScan& scan);
  /// Whether the last scan lay on surfaces.
  [[nodiscard]] bool on_surfaces() const { return on_surfaces_; }

 private:
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
  [[nodiscard]] bool explains_as_usual(const Found& found) const {
    return found.match.known_inlier_ratio >=
               std::max(kLeastInliers, kKnownOfUsual * usual_known_) &&
           found.match.standing_ratio >= kStandingOfUsual * usual_standing_;
  }
  /// Motion of the sensor since the last scan that was not hidden as a rate; as it was, over a gap.
  [[nodiscard]] Vector6d twist_to(const Eigen::Isometry3d& T_odom_lidar,
                                  const ScanPeriod::Step& step) const {
    if (step.is_gap) return last_.twist;
    if (hidden_s_ > 0.0)
      return maps::log_se3(T_odom_seen_.inverse() * T_odom_lidar) / (hidden_s_ + step.seconds);
    return maps::log_se3(last_.T_odom_lidar.inverse() * T_odom_lidar) / step.seconds;
  }
  /// Where the speed leads in so long.
  [[nodiscard]] Prediction by_speed(double seconds, double step_s) const {
    return {
        maps::renormalized(last_.T_odom_lidar *
                           maps::exp_se3(last_.twist * std::min(seconds, ScanPeriod::kMaxGapS))),
        off_after(step_s + hidden_s_, off_rate2_), last_.twist};
  }
  /// Where the sensor is said to have moved.
  [[nodiscard]] std::optional<Prediction> as_expected(const ScanPeriod::Step& step) const {
    if (!expected_) return std::nullopt;
    const Eigen::Isometry3d T = maps::renormalized(last_.T_odom_lidar * *expected_);
    return Prediction{T, off_after(step.seconds + hidden_s_, expected_off_rate2_),
                      twist_to(T, step)};
  }
  [[nodiscard]] double off_after(double seconds, double off_rate2) const {
    const double hidden_m = kHiddenAcceleration * hidden_s_ * hidden_s_;
    return std::clamp(kLeastMissM + kMissDeviations * std::sqrt(off_rate2) * seconds + hidden_m,
                      kLeastMissM, kMostOffM);
  }
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
  void learn_usual(const LocalAlignment& match);
  /// @param off_rate2  of what predicted so, see `off_rate2_`.
  void learn(const Vector6d& deviation, double dt_s, double& off_rate2) const;
  [[nodiscard]] std::vector<Vector6d> untold(const LocalAlignment& match);
  /// Of where a prediction ends after so long without a word, along any direction [m^2].
  [[nodiscard]] double variance_after_m2(double t_s) const {
    const double acceleration = hidden_s_ > 0.0 ? kHiddenAcceleration : kUntoldAcceleration;
    const double by_acceleration_m = 0.5 * acceleration * t_s * t_s;
    return off_rate2_ * t_s * t_s + by_acceleration_m * by_acceleration_m;
  }
  /// Of one step: what it adds to the variance since all was told, so that the steps' own add up
  /// to that of the whole stretch although one wrong speed is in all of them.
  [[nodiscard]] Matrix6d covariance_of_prediction(double dt_s) const {
    const double t_s = std::min(dt_s, ScanPeriod::kMaxGapS);
    const double variance_m2 = kLeastMissM * kLeastMissM / 9.0 +
                               variance_after_m2(untold_s_ + t_s) - variance_after_m2(untold_s_);
    return rotations_times(variance_m2 * Matrix6d::Identity(), 1.0 / kLeverM);
  }
  void take(const ThinnedScan& scan, const OdometryPose& pose);

  LocalMap map_;
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
  bool on_surfaces_ = false;
  /// `ThinnedScan::content` of the scan before.
  std::uint64_t last_content_ = 0;
  std::optional<Eigen::Isometry3d> T_odom_mapped_;
  std::size_t scans_in_map_ = 0;
  /// Mean square of how fast predictions went astray [m^2/s^2].
  double off_rate2_ = kUnknownOffRate * kUnknownOffRate;
  /// See `expect`, and the mean square of how fast that went astray.
  std::optional<Eigen::Isometry3d> expected_;
  double expected_off_rate2_ = kStartOffRate * kStartOffRate;
  /// How long some direction has not been told.
  double untold_s_ = 0.0;
  /// Directions that the last scans did not tell, and how many since do.
  std::vector<Vector6d> lost_;
  /// Of the last scans that told all.
  std::deque<Vector6d> steady_;
  std::size_t told_again_ = 0;
  std::size_t placed_ = 0;
  double usual_known_ = 0.0;
  double usual_standing_ = 0.0;
  double usual_fit_ = 0.0;
  /// See `start_with`.
  std::optional<Vector6d> start_twist_;
  /// Without it the first scan, until the second tells how the sensor moved meanwhile.
  std::optional<ThinnedScan> first_;
};

std::vector<Eigen::Vector3f> deskewed(maps::PointCloud cloud, const Vector6d& twist) {
  maps::deskew(cloud, twist);
  return std::move(cloud.positions);
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
  last_content_ = scan.content;
  return pose;
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
  const bool follows = placed_ > kFirstScans || start_twist_ || expected_;
  if (follows && off_m <= kSearchedOffM && explains_as_usual(best)) return best;
  const auto try_too = [&](Found found) {
    if (found.match.fit > best.match.fit) best = std::move(found);
  };
  try_too(aligned(scan, twist, T_predicted, kMostOffM, step));
  try_too(searched(scan, twist, T_predicted, step));
  if (placed_ <= kFirstScans || explains_as_usual(best)) return best;
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
  if (expected_ && placed_ > kFirstScans && !explains_as_usual(found)) {
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
  if (placed_ > kFirstScans && off_speed_m <= kSearchedOffM) return false;
  const std::vector<Eigen::Vector3f> points = deskewed(scan.sparse, expected.twist);
  const LocalAlignment there = map_.judged(points, expected.T_odom_lidar);
  return there.known_inlier_ratio >= kKnownOfUsual * found.match.known_inlier_ratio &&
         there.standing_ratio >= kStandingOfUsual * found.match.standing_ratio;
}

/// By what was nearer lately. At first by the speed, which is that of several scans, unless it is
/// far from what is expected: then it is that of a match as in `is_denied`.
DirectFollower::Prediction DirectFollower::predicted(const std::optional<Prediction>& expected,
                                                     const ScanPeriod::Step& step) const {
  Prediction speed = by_speed(step.seconds, step.seconds);
  if (!expected) return speed;
  const double apart_m =
      (speed.T_odom_lidar.translation() - expected->T_odom_lidar.translation()).norm();
  const bool is_first = placed_ <= kFirstScans && apart_m > kSearchedOffM;
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
  const LocalAlignment& match = found.match;
  if (placed_ >= kThinScans) {
    if (match.matched < LocalAlignment::kMinMatched ||
        match.known_inlier_ratio < std::max(kLeastInliers, kHiddenOfUsual * usual_known_))
      return true;
    const double fit = match.fit / usual_fit_, standing = match.standing_ratio / usual_standing_;
    if (usual_standing_ >= kStandingTells && fit < kHiddenFitOfUsual &&
        fit * standing < kHiddenMeanOfUsual * kHiddenMeanOfUsual)
      return true;
  }
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
  const bool matches =
      match.matched >= LocalAlignment::kMinMatched && match.known_inlier_ratio >= kLeastInliers;
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
  const bool was_lost = !lost_.empty();
  const std::vector<Vector6d> kept = untold(match);
  pose.degenerate_directions = kept.empty() ? match.degenerate_directions : kept;
  if (!was_lost && !lost_.empty()) {
    if (!steady_.empty()) {
      const Vector6d steady = median_of(steady_);
      last_.twist = steady + without(last_.twist - steady, lost_);
    }
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
  if (all_told) steady_.push_back(pose.twist_lidar);
  if (steady_.size() > kSteadyScans) steady_.pop_front();
  const double predicted_s = step.seconds + hidden_s_;
  if (!step.is_gap)
    learn(deviation_from(by_speed(step.seconds, step.seconds)), predicted_s, off_rate2_);
  if (expected) learn(deviation_from(*expected), predicted_s, expected_off_rate2_);
  learn_usual(match);
}

void DirectFollower::learn_usual(const LocalAlignment& match) {
  on_surfaces_ = match.fit >= kFitOfInliers * match.inlier_ratio;
  ++placed_;
  // The mean of all until there are many, so that the first ones are not doubted less than others.
  const double share = std::max(kNewestShare, 1.0 / static_cast<double>(placed_));
  usual_known_ += share * (match.known_inlier_ratio - usual_known_);
  usual_standing_ += share * (match.standing_ratio - usual_standing_);
  usual_fit_ += share * (match.fit - usual_fit_);
}

/// Directions that are kept as predicted. By chance one scan of a tunnel in thirty seems to tell
/// where along it one is, so they stay lost for a while. Before any speed is known, and nothing
/// else tells, a match, be it weak, is better than to stand still.
std::vector<Vector6d> DirectFollower::untold(const LocalAlignment& match) {
  if (steady_.size() < kSteadyScans && !expected_) return {};
  if (!match.degenerate_directions.empty()) {
    lost_ = match.degenerate_directions;
    told_again_ = 0;
  } else if (!lost_.empty() && ++told_again_ >= kToldAgainScans) {
    lost_.clear();
  }
  return lost_;
}

void DirectFollower::learn(const Vector6d& deviation, double dt_s, double& off_rate2) const {
  const double rate = in_metres(deviation).norm() / dt_s;
  // What is not told may be off by more.
  if (!lost_.empty() && rate * rate < off_rate2) return;
  off_rate2 += kNewestShare * (rate * rate - off_rate2);
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

/// Follows a sensor through its map; and, where scans do not fit there, through one of their own,
/// which is the map once it has proved to be one.
class DirectOdometry : public Odometry {
 public:
  [[nodiscard]] std::unique_ptr<Prepared> prepare(const maps::Scan& scan) const override {
    return std::make_unique<ThinnedScan>(thinned(scan));
  }
  void start_with(const Vector6d& twist_lidar) override { follower_.start_with(twist_lidar); }
  void expect(const Eigen::Isometry3d& T_before_this) override {
    follower_.expect(T_before_this);
    if (candidate_) candidate_->expect(T_before_this);
  }
  [[nodiscard]] OdometryPose add(const Prepared& prepared) override;

 private:
  DirectFollower follower_;
  std::optional<DirectFollower> candidate_;
  /// Scans in a row that fit its map.
  std::size_t fitting_ = 0;
};

OdometryPose DirectOdometry::add(const Prepared& prepared) {
  const auto& scan = dynamic_cast<const ThinnedScan&>(prepared);
  OdometryPose pose = follower_.add(scan);
  if (!pose.hidden) candidate_.reset();
  if (!pose.hidden) return pose;
  if (scan.shell || scan.sparse.size() < kMinPoints) {
    // It is placed by motion there too, so that the next one is looked for from there.
    if (candidate_) (void)candidate_->add(scan);
    return pose;
  }
  if (candidate_) {
    const OdometryPose beside = candidate_->add(scan);
    if (beside.status != OdometryStatus::kPredicted && candidate_->on_surfaces()) {
      if (++fitting_ < kAnewScans) return pose;
      follower_ = std::move(*candidate_);
      candidate_.reset();
      pose.T_odom_lidar = beside.T_odom_lidar;
      pose.twist_lidar = beside.twist_lidar;
      pose.hidden = false;
      pose.begins_anew = true;
      return pose;
    }
  }
  candidate_.emplace(pose.T_odom_lidar);
  candidate_->start_with(pose.twist_lidar);
  (void)candidate_->add(scan);
  fitting_ = 0;
  return pose;
}

}  // namespace

std::unique_ptr<Odometry> make_direct_odometry() { return std::make_unique<DirectOdometry>(); }

}  // namespace stillmap::mapping
