#include <stillmap/mapping/lidar_calibration.hpp>

#include "calibration/followed_lidar.hpp"
#include "calibration/hand_eye.hpp"
#include "odometry/run_odometry.hpp"
#include "registration/frame_fit.hpp"
#include "trajectory/path_difference.hpp"

#include <fmt/format.h>
#include <stillmap/localization/adjoint.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/median.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace stillmap::mapping {
namespace {

using maps::Matrix6d;
using maps::Vector6d;

constexpr double kRadPerDeg = 0.017453292519943295;
constexpr std::int64_t kMotionNs = 4'000'000'000;
constexpr std::int64_t kMotionStepNs = 500'000'000;
constexpr double kLeastCommonS = 10.0;
constexpr std::size_t kBlocks = 10;
/// Clocks count as equal within as many deviations.
constexpr double kClockSigmas = 3.0;
/// `lidars.json` takes no more [s].
constexpr double kMostLidarOffsetS = 1.0;
/// What is known of a clock without turns or changes of speed [s].
constexpr double kUnknownClockS = 0.5;
/// Beyond, a parameter is not observed.
constexpr double kObservedM = 0.1;
constexpr double kObservedRad = 1.0 * kRadPerDeg;
/// A first look at some scans finds what the motions leave open.
constexpr std::size_t kFirstLookScans = 40;
constexpr FrameTolerance kFoundMount{.translation_m = 0.5, .rotation_rad = 2.0 * kRadPerDeg};
constexpr FrameTolerance kSameMount{.translation_m = 0.15, .rotation_rad = 0.7 * kRadPerDeg};
constexpr std::size_t kLeastSights = 20;
/// Twice as many are no nearer to the truth.
constexpr std::size_t kScansEachWay = 300;
constexpr double kFirstOffM = 2.0;
constexpr double kOffM = 0.3;
/// What all scans of a lidar share: constant errors of its lasers, cells of the map. Measured on
/// simulated drives (mapping/decisions/mounts_from_both_maps.md).
constexpr double kSharedSigmaM = 0.002;
constexpr double kSharedSigmaRad = 0.0002;
/// The same of all motions by odometry.
constexpr double kMotionSharedSigmaM = 0.004;
constexpr double kMotionSharedSigmaRad = 0.0001;

FollowedLidar follow(const LidarCalibrationTask& task, const maps::Drive& drive,
                     const CancelFlag& cancel) {
  const std::vector<OdometryPose> poses = run_odometry(
      {.drive = drive, .begin = 0, .end = drive.size()}, task.threads, task.progress, cancel);
  FollowedLidar lidar{drive, {}, {}, 0};
  std::vector<maps::StampedPose> path;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    path.push_back({drive.stamp_ns(i), poses[i].T_odom_lidar});
    lidar.twists.push_back(poses[i].twist_lidar);
  }
  lidar.path = maps::Trajectory(std::move(path));
  return lidar;
}

/// Poses by seconds after a stamp.
std::vector<SmoothPath::Pose> poses_after(const FollowedLidar& lidar, std::int64_t begin_ns) {
  std::vector<SmoothPath::Pose> poses;
  for (const maps::StampedPose& pose : lidar.path.poses())
    poses.push_back({maps::seconds_between(begin_ns, pose.stamp_ns), pose.T_map_lidar});
  return poses;
}

std::optional<ClockOffset> clock_offset(const FollowedLidar& reference,
                                        const FollowedLidar& lidar) {
  const std::int64_t begin_ns = reference.path.poses().front().stamp_ns;
  const auto found =
      path_difference({poses_after(reference, begin_ns), poses_after(lidar, begin_ns)});
  if (!found || !found->converged || !(found->offset_s.sigma < kUnknownClockS)) return std::nullopt;
  return ClockOffset{found->offset_s.value, found->offset_s.sigma,
                     found->offset_s.is_off(0.0, kClockSigmas)};
}

void shift_clock(FollowedLidar& lidar, std::int64_t offset_ns) {
  std::vector<maps::StampedPose> path = lidar.path.poses();
  for (maps::StampedPose& pose : path) pose.stamp_ns += offset_ns;
  lidar.path = maps::Trajectory(std::move(path));
  lidar.offset_ns += offset_ns;
}

/// Motions of both over the same times, by the reference's scans.
struct CommonMotions {
  std::vector<MotionPair> motions;
  std::vector<std::size_t> blocks;
};

CommonMotions common_motions(const FollowedLidar& reference, const FollowedLidar& lidar) {
  CommonMotions common;
  const auto& poses = reference.path.poses();
  const std::int64_t begin_ns =
      std::max(poses.front().stamp_ns, lidar.path.poses().front().stamp_ns);
  const std::int64_t end_ns = std::min(poses.back().stamp_ns, lidar.path.poses().back().stamp_ns);
  if (!(maps::seconds_between(begin_ns, end_ns) >= kLeastCommonS))
    throw maps::InputError(
        lidar.drive.contents().root.string(),
        fmt::format("{:.1f} s in common with {}", maps::seconds_between(begin_ns, end_ns),
                    reference.drive.contents().root.string()),
        fmt::format(
            "{:g} s or more, some 60 s with turns: give two drives of the same time, by one "
            "clock",
            kLeastCommonS));
  for (std::int64_t first_ns = begin_ns; first_ns + kMotionNs <= end_ns;
       first_ns += kMotionStepNs) {
    const std::int64_t last_ns = first_ns + kMotionNs;
    const auto of = [&](const maps::Trajectory& path) {
      return Eigen::Isometry3d(path.at(first_ns, 0.0)->inverse() * *path.at(last_ns, 0.0));
    };
    common.motions.push_back({of(reference.path), of(lidar.path)});
    common.blocks.push_back(static_cast<std::size_t>(
        maps::seconds_between(begin_ns, first_ns) * static_cast<double>(kBlocks) /
        (maps::seconds_between(begin_ns, end_ns) + 1e-9)));
  }
  return common;
}

/// Median speed of the reference along its own axes [m/s].
Eigen::Vector3d usual_speed(std::span<const MotionPair> motions) {
  Eigen::Vector3d speed;
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    std::vector<double> values;
    for (const MotionPair& motion : motions)
      values.push_back(motion.T_reference.translation()[axis]);
    speed[axis] = maps::median(std::move(values)) / (1e-9 * static_cast<double>(kMotionNs));
  }
  return speed;
}

/// Deviations that no part of the drive shows.
struct SharedErrors {
  double sigma_m;
  double sigma_rad;
  /// By the clock.
  Eigen::Vector3d shift_m;
};

LidarMount mount_of(const MountEstimate& estimate, const SharedErrors& shared, std::size_t used) {
  LidarMount mount{estimate.T_reference_lidar, estimate.covariance, used};
  mount.covariance.diagonal().head<3>().array() += shared.sigma_m * shared.sigma_m;
  mount.covariance.diagonal().tail<3>().array() += shared.sigma_rad * shared.sigma_rad;
  mount.covariance.topLeftCorner<3, 3>() += shared.shift_m * shared.shift_m.transpose();
  return mount;
}

std::vector<FrameSight> frame_sights(std::span<const MountSight> sights) {
  std::vector<FrameSight> all;
  for (const MountSight& sight : sights)
    all.push_back({Eigen::Isometry3d::Identity(), sight.T_reference_lidar, sight.covariance});
  return all;
}

/// The same sights from the other side.
std::vector<MountSight> turned_round(std::vector<MountSight> sights) {
  for (MountSight& sight : sights) {
    const Matrix6d Ad = localization::adjoint(sight.T_reference_lidar);
    sight.covariance = Ad * sight.covariance * Ad.transpose();
    sight.T_reference_lidar = sight.T_reference_lidar.inverse();
  }
  return sights;
}

Eigen::Isometry3d mount_from(std::span<const MountSight> sights, const Eigen::Isometry3d& start) {
  return fit_frames(frame_sights(sights), start, kSameMount).T_map_own;
}

/// Covariance of the mount by parts of the drive.
Matrix6d covariance_by_parts(std::span<const MountSight> sights, const Eigen::Isometry3d& T) {
  const auto [first, last] = std::ranges::minmax_element(sights, {}, &MountSight::stamp_ns);
  const double span_s = maps::seconds_between(first->stamp_ns, last->stamp_ns) + 1e-9;
  std::vector<Vector6d> without;
  for (std::size_t block = 0; block < kBlocks; ++block) {
    std::vector<MountSight> others;
    for (const MountSight& sight : sights) {
      const double at = maps::seconds_between(first->stamp_ns, sight.stamp_ns) / span_s;
      if (static_cast<std::size_t>(at * kBlocks) != block) others.push_back(sight);
    }
    if (others.empty()) return unknown_mount_covariance();
    without.push_back(difference_of_mounts(mount_from(others, T), T));
  }
  return jackknife_covariance(without);
}

class MapCalibration {
 public:
  MapCalibration(const LidarCalibrationTask& task, const FollowedLidar& reference,
                 const FollowedLidar& lidar, const CancelFlag& cancel)
      : task_(task), reference_(reference), lidar_(lidar), cancel_(cancel) {}

  /// @param start  what the motions tell. @param shift_m  by the clock. @param overlap  set.
  [[nodiscard]] std::optional<LidarMount> run(const Eigen::Isometry3d& start,
                                              const Eigen::Vector3d& shift_m,
                                              double& overlap) const {
    const std::vector<MountSight> first =
        find_sights({reference_, lidar_, start, kFirstOffM, true, kFirstLookScans, task_.threads,
                     task_.progress},
                    cancel_);
    const auto agreed = most_agreed(frame_sights(first), kFoundMount, 5);
    if (!agreed) return std::nullopt;
    const Eigen::Isometry3d near = mount_from(first, *agreed);
    const std::vector<MountSight> there = all_sights(reference_, lidar_, near);
    const std::vector<MountSight> back =
        turned_round(all_sights(lidar_, reference_, near.inverse()));
    std::vector<MountSight> all = there;
    all.insert(all.end(), back.begin(), back.end());
    if (std::min(there.size(), back.size()) < kLeastSights) return std::nullopt;
    std::vector<double> ratios;
    for (const MountSight& sight : all) ratios.push_back(sight.inlier_ratio);
    overlap = maps::median(std::move(ratios));
    const Eigen::Isometry3d one = mount_from(there, near), other = mount_from(back, near);
    const Vector6d half = 0.5 * difference_of_mounts(one, other);
    const Eigen::Isometry3d T = changed_mount(other, half);
    Matrix6d covariance = covariance_by_parts(all, mount_from(all, near));
    covariance.diagonal() += half.cwiseAbs2();
    return mount_of({T, covariance}, {kSharedSigmaM, kSharedSigmaRad, shift_m}, all.size());
  }

 private:
  [[nodiscard]] std::vector<MountSight> all_sights(const FollowedLidar& map,
                                                   const FollowedLidar& lidar,
                                                   const Eigen::Isometry3d& T) const {
    return find_sights({map, lidar, T, kOffM, false, kScansEachWay, task_.threads, task_.progress},
                       cancel_);
  }

  const LidarCalibrationTask& task_;
  const FollowedLidar& reference_;
  const FollowedLidar& lidar_;
  const CancelFlag& cancel_;
};

}  // namespace

Vector6d LidarMount::values() const {
  Vector6d values;
  values << T_reference_lidar.translation(), maps::roll_pitch_yaw_rad(T_reference_lidar.linear());
  return values;
}

Vector6d LidarMount::sigma() const {
  constexpr double kStepRad = 1e-6;
  Eigen::Matrix3d J;
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    const auto turned = [&](double by_rad) {
      return maps::roll_pitch_yaw_rad(maps::exp_so3(by_rad * Eigen::Vector3d::Unit(axis)) *
                                      T_reference_lidar.linear());
    };
    const Eigen::Vector3d change = turned(kStepRad) - turned(-kStepRad);
    for (Eigen::Index k = 0; k < 3; ++k)
      J(k, axis) = std::remainder(change[k], 2.0 * std::numbers::pi) / (2.0 * kStepRad);
  }
  Vector6d variances = covariance.diagonal();
  variances.tail<3>() = (J * covariance.bottomRightCorner<3, 3>() * J.transpose()).diagonal();
  return variances.cwiseSqrt();
}

std::vector<std::string> LidarCalibration::unobserved() const {
  std::vector<std::string> names;
  const Vector6d sigma = mount().sigma();
  for (std::size_t i = 0; i < kMountParameters.size(); ++i) {
    if (!(sigma[static_cast<Eigen::Index>(i)] <= (i < 3 ? kObservedM : kObservedRad)))
      names.emplace_back(kMountParameters[i]);
  }
  return names;
}

LidarCalibration calibrate_lidars(const LidarCalibrationTask& task, const CancelFlag& cancel) {
  const FollowedLidar reference = follow(task, task.reference, cancel);
  FollowedLidar lidar = follow(task, task.lidar, cancel);
  LidarCalibration calibration;
  calibration.clock = clock_offset(reference, lidar);
  if (calibration.clock && std::abs(calibration.clock->offset_s) > kMostLidarOffsetS)
    throw maps::InputError(
        task.lidar.contents().root.string(),
        fmt::format("a clock that is {:.3f} s from that of {}", -calibration.clock->offset_s,
                    task.reference.contents().root.string()),
        fmt::format("{:g} s at most: add {:.3f} s to its stamps", kMostLidarOffsetS,
                    calibration.clock->offset_s));
  if (calibration.clock && calibration.clock->is_used)
    shift_clock(lidar, std::llround(1e9 * calibration.clock->offset_s));
  const CommonMotions common = common_motions(reference, lidar);
  const auto hand_eye = fit_hand_eye_in_blocks(common.motions, common.blocks);
  if (!hand_eye)
    throw maps::InputError(
        task.lidar.contents().root.string(),
        fmt::format("{} motions of both lidars that do not tell how one is turned to the other",
                    common.motions.size()),
        "a drive with turns and straight ways, of 60 s or so: record one");
  const double clock_sigma_s = calibration.clock ? calibration.clock->sigma_s : kUnknownClockS;
  const Eigen::Vector3d shift_m = clock_sigma_s * usual_speed(common.motions);
  calibration.from_motion = mount_of(
      *hand_eye, {kMotionSharedSigmaM, kMotionSharedSigmaRad, shift_m}, common.motions.size());
  calibration.from_maps = MapCalibration(task, reference, lidar, cancel)
                              .run(hand_eye->T_reference_lidar, shift_m, calibration.overlap);
  return calibration;
}

}  // namespace stillmap::mapping
