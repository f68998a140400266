#include "core/seconds_since.hpp"
#include "loops/loop_finder.hpp"
#include "odometry/gravity.hpp"
#include "odometry/run_odometry.hpp"
#include "pose_graph/pose_graph.hpp"
#include "trajectory/common_frame.hpp"
#include "trajectory/corrected_poses.hpp"
#include "trajectory/given_pose_errors.hpp"
#include "trajectory/keyframes.hpp"
#include "trajectory/levelling.hpp"
#include "trajectory/trajectory_graph.hpp"

#include <fmt/format.h>
#include <stillmap/mapping/trajectory.hpp>
#include <stillmap/maps/deskew.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/imu.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

namespace stillmap::mapping {
namespace {

using Clock = std::chrono::steady_clock;

/// Of `default` where given poses hold the whole: measured were 0.5 to 1 cm and 0.01 deg over 10 m
/// (mapping/given_poses.md). Alone it is believed less, so that a right loop is not given up.
constexpr OdometryDrift kHeldDrift{0.004, 1e-4, 0.003, 1e-4};

/// Noise as it is told leaves hardly any measurement less weight.
constexpr double kDenied = 0.1;

/// What odometry leaves behind.
struct Odometries {
  std::vector<EstimatedDrive> drives;
  std::vector<DriveKeyframe> keyframes;
  /// Of each drive, by its first key frame, see `T_ground_lidar`.
  std::vector<Eigen::Isometry3d> T_ground_odom;
  /// For people.
  std::vector<std::string> notes;
};

/// Follows drives by odometry, and gives their key frames to the search for loops.
class Following {
 public:
  /// @param finder  nullptr = no loops are looked for.
  /// @param read    empty = scans are read as the drive has them.
  Following(const TrajectoryOptions& options, LoopFinder* finder, const ScanReader& read)
      : options_(options),
        finder_(finder),
        read_(read),
        drift_(options.refine_given ? kHeldDrift : OdometryDrift{}) {}

  /// Drives in their order.
  void follow(const maps::Drive& drive, const ProgressCallback& progress,
              const CancelFlag& cancel) {
    const std::size_t end = std::min(options_.end.value_or(drive.size()), drive.size());
    EstimatedDrive& estimated = found_.drives.emplace_back();
    estimated.begin = options_.begin;
    KeyframeChooser chooser;
    const auto take = [&](std::size_t index, const maps::Scan& scan, const OdometryPose& pose) {
      if (const auto chosen = chooser.add(pose)) add_keyframe(index, scan, pose, *chosen);
    };
    FollowedDrive followed{.drive = drive,
                           .begin = options_.begin,
                           .end = end,
                           .method = options_.odometry,
                           .expects_given_poses = options_.refine_given,
                           .take = take};
    if (read_) followed.read = [&](std::size_t index) { return read_(drive, index); };
    estimated.odometry = run_odometry(followed, options_.threads, progress, cancel);
    if (estimated.keyframes.empty())
      throw maps::InputError(
          drive.contents().root.string(),
          fmt::format("{} scans, all hidden (covered sensor or dust)", estimated.odometry.size()),
          "a drive whose sensor is not covered; leave this drive out of the build");
    const Vertical vertical = up_in_odom(drive, estimated.begin, estimated.odometry);
    const std::string note = level(vertical, ground_is_seen_, found_.T_ground_odom.back());
    if (!note.empty()) found_.notes.push_back(drive.contents().imu->source + ": " + note);
  }

  [[nodiscard]] Odometries finish() { return std::move(found_); }

 private:
  /// Of the drive that is followed.
  void add_keyframe(std::size_t index, const maps::Scan& scan, const OdometryPose& pose,
                    const KeyframeChooser::Chosen& chosen) {
    EstimatedDrive& estimated = found_.drives.back();
    const std::size_t drive = found_.drives.size() - 1;
    maps::PointCloud cloud = scan.cloud;
    maps::deskew(cloud, pose.twist_lidar);
    if (estimated.keyframes.empty()) {
      Eigen::Isometry3d T_ground_odom = T_ground_lidar(cloud);
      ground_is_seen_ = !T_ground_odom.isApprox(Eigen::Isometry3d::Identity());
      if (index > options_.begin) T_ground_odom = T_ground_odom * pose.T_odom_lidar.inverse();
      found_.T_ground_odom.push_back(T_ground_odom);
    }
    estimated.keyframes.push_back(index);
    found_.keyframes.push_back({.drive = drive,
                                .scan = index,
                                .T_odom_lidar = pose.T_odom_lidar,
                                .T_before_this = chosen.T_before_this,
                                .covariance = chosen.covariance(drift_)});
    if (finder_ == nullptr) return;
    finder_->add({.points = std::move(cloud.positions),
                  .T_odom_lidar = pose.T_odom_lidar,
                  .covariance = chosen.covariance(),
                  .drive = static_cast<std::uint32_t>(drive)});
  }

  const TrajectoryOptions& options_;
  LoopFinder* finder_;
  const ScanReader& read_;
  OdometryDrift drift_;
  Odometries found_;
  /// From the first key frame of the drive that is followed.
  bool ground_is_seen_ = false;
};

bool asks_given(const TrajectoryOptions& options) {
  return options.prior || options.gnss_sigma_m || options.refine_given;
}

/// One a key frame, in the frame of the first drive's.
std::vector<Eigen::Isometry3d> given_of(const std::vector<maps::Drive>& drives,
                                        std::span<const DriveKeyframe> keyframes) {
  std::vector<Eigen::Isometry3d> given;
  for (const DriveKeyframe& keyframe : keyframes) {
    const maps::Drive& drive = drives[keyframe.drive];
    given.push_back(T_first_own(drives.front(), drive) * drive.T_map_lidar(keyframe.scan));
  }
  return given;
}

GivenPoseErrors errors_of(const std::vector<maps::Drive>& drives, const Odometries& odometries) {
  std::vector<TwicePosed> posed;
  for (std::size_t i = 0; i < drives.size(); ++i) {
    const EstimatedDrive& estimated = odometries.drives[i];
    posed.push_back({estimated.odometry, std::span(drives[i].contents().T_map_lidar)
                                             .subspan(estimated.begin, estimated.odometry.size())});
  }
  return given_pose_errors(posed);
}

/// What the graph is told of the drives' own poses.
GivenPoses given_poses(std::vector<Eigen::Isometry3d> T_map_keyframe,
                       const TrajectoryOptions& options,
                       const std::optional<GivenPoseErrors>& errors) {
  GivenPoses given;
  if (options.gnss_sigma_m) {
    given.sigma_m = *options.gnss_sigma_m;
    given.doubtful = true;
  } else if (options.prior) {
    given.sigma_m = options.prior->sigma_m;
    given.sigma_rad = options.prior->sigma_rad;
  } else if (errors) {
    // So many neighbours repeat one error.
    const double repeated = std::sqrt(std::max(1.0, errors->correlated_m / kGivenApartM));
    given.sigma_m = repeated * errors->sigma_m;
    given.sigma_rad = repeated * errors->sigma_rad;
    given.doubtful = true;
  }
  given.T_map_keyframe = std::move(T_map_keyframe);
  return given;
}

void require_joined(const std::vector<maps::Drive>& drives,
                    std::span<const DriveKeyframe> keyframes, std::span<const Loop> loops) {
  if (const auto apart = drive_apart(drives.size(), keyframes, loops))
    throw maps::InputError(drives[*apart].contents().root.string(),
                           "no place that the other drives have seen too",
                           "drives that overlap: give poses for every drive (with --pose-sigma or "
                           "--gnss-sigma), or build this drive as a map of its own");
}

/// Given poses that the rest of the graph denies.
std::size_t denied_in(const PoseGraphSolution& solution) {
  return static_cast<std::size_t>(std::ranges::count_if(
      solution.absolute_weights, [](double weight) { return weight < kDenied; }));
}

void correct(Odometries& odometries, const std::vector<Eigen::Isometry3d>& T_map_keyframe) {
  std::size_t first = 0;
  for (EstimatedDrive& drive : odometries.drives) {
    std::vector<std::size_t> numbers;
    for (const std::size_t scan : drive.keyframes) numbers.push_back(scan - drive.begin);
    drive.T_map_lidar = corrected_poses(drive.odometry, numbers,
                                        std::span(T_map_keyframe).subspan(first, numbers.size()));
    first += numbers.size();
  }
}

std::vector<EstimatedLoop> named(std::span<const Loop> loops,
                                 std::span<const DriveKeyframe> keyframes,
                                 std::span<const double> weights) {
  std::vector<EstimatedLoop> named;
  for (std::size_t i = 0; i < loops.size(); ++i) {
    const DriveKeyframe& from = keyframes[loops[i].from];
    const DriveKeyframe& to = keyframes[loops[i].to];
    named.push_back({.from_drive = from.drive,
                     .from_scan = from.scan,
                     .to_drive = to.drive,
                     .to_scan = to.scan,
                     .T_from_to = loops[i].T_from_to,
                     .covariance = loops[i].covariance,
                     .weight = weights[i]});
  }
  return named;
}

void check(const std::vector<maps::Drive>& drives, const TrajectoryOptions& options) {
  if (drives.empty()) throw std::invalid_argument("drives: none, expected at least one");
  if (const auto broken = options.violations(); !broken.empty())
    throw std::invalid_argument("trajectory options: " + broken.front());
  if (drives.size() > 1 && !options.loops && !asks_given(options))
    throw std::invalid_argument(
        "loops: found off with several drives, expected on, as nothing else tells where the drives "
        "are to each other: give --loops on, or poses for every drive (with --pose-sigma or "
        "--gnss-sigma)");
  for (const maps::Drive& drive : drives) {
    if (options.begin >= std::min(options.end.value_or(drive.size()), drive.size()))
      throw maps::InputError(drive.contents().root.string(),
                             fmt::format("{} scans, none selected", drive.size()),
                             "at least one: change --select");
    if (asks_given(options) && !drive.has_poses())
      throw maps::InputError(
          drive.contents().root.string(), "a drive without poses",
          "poses: give --poses FILE, or leave out --pose-sigma and --gnss-sigma");
  }
}

}  // namespace

std::vector<std::string> TrajectoryOptions::violations() const {
  std::vector<std::string> broken;
  const auto check_positive = [&](const char* name, double value, double most) {
    if (!(value > 0.0 && value <= most))
      broken.push_back(fmt::format("{}: {}, expected in (0, {}]", name, value, most));
  };
  if (prior) {
    check_positive("prior.sigma_m (--pose-sigma)", prior->sigma_m, 1e4);
    check_positive("prior.sigma_rad (--pose-sigma)", prior->sigma_rad, 3.2);
  }
  if (gnss_sigma_m) check_positive("gnss_sigma_m (--gnss-sigma)", *gnss_sigma_m, 1e4);
  if (prior && gnss_sigma_m)
    broken.emplace_back(
        "gnss_sigma_m (--gnss-sigma): found beside a prior (--pose-sigma), expected one of them: "
        "leave one out");
  if (refine_given && (prior || gnss_sigma_m))
    broken.emplace_back(
        "refine_given (--given-poses refine): found beside a prior (--pose-sigma) or GNSS "
        "(--gnss-sigma), expected one of them: leave the others out");
  if (threads < 0 || threads > 256)
    broken.push_back(fmt::format("threads (--threads): {}, expected in [0, 256]", threads));
  return broken;
}

TrajectoryEstimate estimate_trajectories(const std::vector<maps::Drive>& drives,
                                         const TrajectoryOptions& options,
                                         const std::filesystem::path& scratch,
                                         const ProgressCallback& progress, const CancelFlag& cancel,
                                         const ScanReader& read) {
  check(drives, options);
  TrajectoryEstimate estimate;
  Clock::time_point began = Clock::now();
  std::optional<LoopFinder> finder;
  if (options.loops) finder.emplace(scratch);
  Following following(options, finder ? &*finder : nullptr, read);
  for (const maps::Drive& drive : drives) following.follow(drive, progress, cancel);
  Odometries odometries = following.finish();
  estimate.odometry_seconds = seconds_since(began);

  began = Clock::now();
  std::vector<Eigen::Isometry3d> T_map_given;
  if (asks_given(options)) T_map_given = given_of(drives, odometries.keyframes);
  if (options.refine_given) estimate.given_errors = errors_of(drives, odometries);
  std::vector<Loop> loops;
  if (finder) {
    std::optional<GivenPlaces> places;
    if (const auto& errors = estimate.given_errors)
      places = GivenPlaces{T_map_given, errors->sigma_m, errors->sigma_rad};
    loops = finder->find(options.threads, progress, cancel, places);
    if (estimate.given_errors) widen_by_loops(loops, T_map_given, *estimate.given_errors);
  }
  estimate.loop_seconds = seconds_since(began);

  began = Clock::now();
  if (progress) progress("pose graph", 0, 1);
  if (T_map_given.empty()) require_joined(drives, odometries.keyframes, loops);
  const GivenPoses given = given_poses(std::move(T_map_given), options, estimate.given_errors);
  PoseGraph graph = graph_of(odometries.keyframes, loops, given, odometries.T_ground_odom);
  PoseGraphSolution solution = solve(graph, cancel);
  const std::size_t denied = denied_in(solution);
  if (2 * denied > solution.absolute_weights.size()) {
    // Not a few of them are wrong: then it is not known which, and they hold the frame.
    for (AbsolutePose& pose : graph.absolute_poses) pose.doubtful = false;
    solution = solve(graph, cancel);
  }
  estimate.graph_seconds = seconds_since(began);

  if (auto& errors = estimate.given_errors) {
    errors->asked = solution.absolute_weights.size();
    errors->denied = denied;
  }

  correct(odometries, solution.nodes);
  const auto loop_weights = std::span(solution.relative_weights).last(loops.size());
  estimate.loops = named(loops, odometries.keyframes, loop_weights);
  if (asks_given(options)) estimate.origin = drives.front().contents().origin;
  estimate.drives = std::move(odometries.drives);
  if (!asks_given(options)) estimate.notes = std::move(odometries.notes);
  return estimate;
}

}  // namespace stillmap::mapping
