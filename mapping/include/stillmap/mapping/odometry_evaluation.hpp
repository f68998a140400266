#pragma once

#include <stillmap/mapping/odometry.hpp>
#include <stillmap/mapping/progress.hpp>
#include <stillmap/mapping/projection.hpp>
#include <stillmap/maps/drive.hpp>

#include <Eigen/Geometry>

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// Of many errors; NaN where there are none.
struct ErrorFigures {
  double mean = 0.0, rmse = 0.0, median = 0.0, max = 0.0;
};

/// Mean errors of KITTI's segments of one length.
struct LengthErrors {
  double length_m = 0.0;
  std::size_t segments = 0;
  double translation_percent = 0.0;
  double rotation_deg_per_100m = 0.0;
};

/// KITTI's odometry metric; NaN where the path is shorter than 100 m.
struct KittiErrors {
  std::size_t segments = 0;
  double translation_percent = 0.0;
  double rotation_deg_per_100m = 0.0;
  /// Lengths that the path reaches.
  std::vector<LengthErrors> lengths = {};
};

/// Errors of the motion between two poses.
struct RelativeErrors {
  /// Over 10 m: segments, means. NaN where the path is shorter.
  std::size_t segments_10m = 0;
  double translation_percent_10m = 0.0;
  double rotation_deg_10m = 0.0;
  /// From a pose to the next.
  ErrorFigures step_translation_m;
  ErrorFigures step_rotation_deg;
};

/// A path against the true one.
struct TrajectoryErrors {
  /// Poses with a true one, and the true way between first and last.
  std::size_t poses = 0;
  double way_m = 0.0;
  KittiErrors kitti;
  RelativeErrors relative;
  /// Distances of the positions (APE, ATE) after the rigid motion, without scale, that fits best.
  ErrorFigures aligned_m;
  /// The same with nothing but the first poses laid upon each other.
  ErrorFigures from_start_m;
  /// What fits best.
  Eigen::Isometry3d T_truth_estimate = Eigen::Isometry3d::Identity();
  /// One a pose: true way up to it, distance aligned and from the start.
  std::vector<std::array<double, 3>> course_m;
};

/// A loop between two keyframes, as it was found.
struct EvaluatedLoop {
  /// Among the key frames that are judged; `to` is the later one.
  std::size_t from = 0;
  std::size_t to = 0;
  /// The same as scans of the drive.
  std::size_t from_scan = 0, to_scan = 0;
  Eigen::Isometry3d T_from_to = Eigen::Isometry3d::Identity();
  /// How much of it the pose graph believed, in [0, 1].
  double weight = 1.0;
  /// Filled by the evaluation: how far it is from the true motion.
  double translation_error_m = 0.0;
  double rotation_error_deg = 0.0;
  bool right = false;
};

/// How loops stand to the places that were driven again.
struct LoopScores {
  std::size_t found = 0, right = 0;
  std::size_t revisits = 0, revisits_found = 0;
  /// Right ones of those found; NaN where none were.
  double precision = 0.0;
  /// Keyframes at places driven before that a right loop lies at; NaN where there are none.
  double recall = 0.0;
  /// The loops with their errors.
  std::vector<EvaluatedLoop> loops;
};

struct OdometryEvaluationOptions {
  /// Scans that are followed and judged; a step other than 1 is refused, since odometry needs all.
  maps::Selection selection;
  /// One of `odometry_names()`.
  std::string method = "default";
  /// Also with loops and pose graph.
  bool loops = true;
  /// What happens to movable points before odometry sees a scan, as the paper does it: boxes of the
  /// scan alone, without margins, to its mean ground height or away.
  MovablePolicy movable = MovablePolicy::kKeep;
  /// What finds them, as `make_detector` takes it.
  std::string detector = "voxelnext";
  /// True poses instead of the drive's own, one entry a scan of the drive; scans without one are
  /// followed but not judged. Empty = the drive's own.
  std::vector<std::optional<Eigen::Isometry3d>> reference;
  /// In [0, 256], 0 = all cores.
  int threads = 0;

  /// Every broken bound as "name: value, bound"; empty when usable.
  [[nodiscard]] std::vector<std::string> violations() const;
};

/// A scan of the drive that was followed.
struct FollowedScan {
  std::size_t scan = 0;
  std::int64_t stamp_ns = 0;
  OdometryStatus status = OdometryStatus::kPredicted;
  /// As in `OdometryPose`.
  bool hidden = false;
  bool begins_anew = false;
  /// By odometry alone; the frame is that of the first scan.
  Eigen::Isometry3d T_odom_lidar = Eigen::Isometry3d::Identity();
  /// After loops and pose graph, in a frame of the estimate's; the same as odometry's but for the
  /// frame when there are no loops.
  Eigen::Isometry3d T_map_lidar = Eigen::Isometry3d::Identity();
  std::optional<Eigen::Isometry3d> T_truth_lidar;
};

/// Points of the scans, and what became of them before odometry.
struct TreatedPoints {
  std::uint64_t in = 0, projected = 0, deleted = 0;
};

struct OdometryEvaluation {
  OdometryEvaluationOptions options;
  /// The drive's own, and what was found of its IMU.
  std::vector<std::string> notes;
  std::size_t scans = 0;
  double seconds = 0.0;
  /// Wall time of odometry with reading its scans, what is done to their points, and key frames.
  double odometry_seconds = 0.0;
  double loop_seconds = 0.0;
  double graph_seconds = 0.0;
  double scans_per_second = 0.0;
  std::size_t matched = 0, partly = 0, predicted = 0;
  TreatedPoints points;
  std::vector<FollowedScan> path;
  TrajectoryErrors odometry;
  /// After loops and pose graph; only when asked for.
  std::optional<TrajectoryErrors> corrected;
  std::optional<LoopScores> loops;
  /// Entries of `path` that are key frames.
  std::vector<std::size_t> keyframes;

  /// Of the path that was asked for: corrected with loops, else odometry's.
  [[nodiscard]] const TrajectoryErrors& errors() const { return corrected ? *corrected : odometry; }
  [[nodiscard]] const Eigen::Isometry3d& pose(const FollowedScan& scan) const {
    return corrected ? scan.T_map_lidar : scan.T_odom_lidar;
  }
};

/// Follows a drive without looking at its poses, and compares with them.
///
/// Figures are over the scans with a true pose; KITTI's segments begin at every tenth of these.
/// Loops are judged where both their key frames have one.
/// @param scratch  existing folder for what does not stay in memory.
/// @throws maps::InputError for a drive without poses or without selected scans;
/// std::invalid_argument for broken options; Cancelled, and what reading and odometry throw.
[[nodiscard]] OdometryEvaluation evaluate_odometry(const maps::Drive& drive,
                                                   const OdometryEvaluationOptions& options,
                                                   const std::filesystem::path& scratch,
                                                   const ProgressCallback& progress,
                                                   const CancelFlag& cancel);

/// The object of `--json`: `kitti {translation_percent, rotation_deg_per_100m}`, `ape_mean_m`,
/// `ate_rmse_m`, `rpe {translation_percent_10m, rotation_deg_10m}` of the path that was asked for,
/// `loops {found, precision, recall}`, `scans_per_second`, `scans_hidden` and `scans_begun_anew`
/// (numbers of scans), and the same for odometry alone and with
/// loops. What could not be known is null.
[[nodiscard]] std::string to_json(const OdometryEvaluation& evaluation);

/// What a report says of itself; plain text, escaped when it is written.
struct OdometryReportHeading {
  std::string drive;
  /// How to make it again.
  std::string command;
};

/// A page of `--report`: one HTML file that needs no other, without scripts. Paths from above with
/// the loops, distances along the way, errors by length of segment.
/// @note  The same evaluation gives the same bytes; only times differ from run to run.
[[nodiscard]] std::string to_html(const OdometryEvaluation& evaluation,
                                  const OdometryReportHeading& heading);

}  // namespace stillmap::mapping
