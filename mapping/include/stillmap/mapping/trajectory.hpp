#pragma once

#include <stillmap/mapping/odometry.hpp>
#include <stillmap/mapping/progress.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/scan.hpp>

#include <Eigen/Geometry>

#include <cstddef>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// How poses are estimated if those of the drive are not used as they are.
struct TrajectoryOptions {
  /// One of `odometry_names()`.
  std::string odometry = "default";
  /// Find loops, and optimise the pose graph.
  bool loops = true;
  /// Standard deviations of the drive's own poses [m, rad], > 0, the same in every direction.
  struct Prior {
    double sigma_m = 0.0;
    double sigma_rad = 0.0;
  };
  std::optional<Prior> prior;
  /// For GNSS: only the positions of the drive's own poses are used, with this standard deviation
  /// [m], > 0. Not together with `prior`.
  std::optional<double> gnss_sigma_m;
  /// Refine the drive's own poses. Scans are searched at these poses. The poses are a prior whose
  /// deviation is measured: how far they differ from odometry and loops (`GivenPoseErrors`). Not
  /// together with `prior` or `gnss_sigma_m`.
  bool refine_given = false;
  /// Scans of a drive that take part: [begin, end), end cut to the drive's size.
  std::size_t begin = 0;
  std::optional<std::size_t> end;
  /// 0 = all cores.
  int threads = 0;

  [[nodiscard]] std::vector<std::string> violations() const;
};

/// How far poses, or motions between two of them, differ.
struct PoseDifferences {
  /// Of motions: way between the two poses [m]; 0 = neighbours.
  double way_m = 0.0;
  std::size_t pairs = 0;
  double median_m = 0.0, p95_m = 0.0, max_m = 0.0;
  double median_rad = 0.0, p95_rad = 0.0, max_rad = 0.0;
};

/// How far given poses are from the scans' own motion.
struct GivenPoseErrors {
  /// Neighbours first. Scans that odometry did not match, at least along one direction, are left
  /// out.
  std::vector<PoseDifferences> by_way;
  /// Of all pairs of neighbours that count [m].
  std::vector<double> neighbours_m;
  /// Between the two ends of loops.
  PoseDifferences loops;
  /// Standard deviation of a given pose in each direction, from these medians and the loops [m,
  /// rad].
  double sigma_m = 0.0;
  double sigma_rad = 0.0;
  /// Errors of poses are correlated up to this distance along the way [m].
  double correlated_m = 0.0;
  /// Given poses that were compared, and how many of them contradict the rest of the graph.
  std::size_t asked = 0;
  std::size_t denied = 0;

  /// Whether given poses agree with the scans as well as odometry does with itself, over 10 m and
  /// at loops: then nothing is gained by moving them.
  [[nodiscard]] bool agree() const;
};

/// A place that was seen twice.
struct EstimatedLoop {
  std::size_t from_drive = 0, from_scan = 0;
  std::size_t to_drive = 0, to_scan = 0;
  Eigen::Isometry3d T_from_to = Eigen::Isometry3d::Identity();
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Identity();
  /// Weight that the pose graph gave to it, in [0, 1].
  double weight = 1.0;
};

struct EstimatedDrive {
  std::size_t begin = 0;
  /// As odometry had them, one a scan from `begin` on.
  std::vector<OdometryPose> odometry;
  /// Corrected, the same scans.
  std::vector<Eigen::Isometry3d> T_map_lidar;
  /// Scans that are key frames, ascending.
  std::vector<std::size_t> keyframes;
};

struct TrajectoryEstimate {
  std::vector<EstimatedDrive> drives;
  std::vector<EstimatedLoop> loops;
  /// Of the map frame, where priors or GNSS gave it.
  std::optional<maps::GeodeticOrigin> origin;
  /// With `refine_given`.
  std::optional<GivenPoseErrors> given_errors;
  /// What the accelerometers told of the vertical, for people. Empty where given poses are used.
  std::vector<std::string> notes;
  double odometry_seconds = 0.0;
  double loop_seconds = 0.0;
  double graph_seconds = 0.0;
};

/// Reads a scan of a drive, possibly changed (for example with projected objects). Safe from
/// several threads.
using ScanReader = std::function<maps::Scan(const maps::Drive& drive, std::size_t scan)>;

/// Odometry over every drive, loops within and between them, pose graph.
///
/// Key frames are a metre or 10 degrees apart; the poses of the scans between them follow their
/// corrections. The map frame is that of the drives' poses where these are a prior or GNSS; else
/// the ground below the first scan that is not hidden, z its normal, x forward. Hidden scans have
/// poses, but are no key frames.
/// @param drives   at least one.
/// @param scratch  existing folder for what does not stay in memory.
/// @param read     none = `Drive::read`.
/// @throws std::invalid_argument (options), maps::InputError (also for a drive that shares no place
/// with the others, one of hidden scans alone, or poses that are asked for and absent),
/// maps::StorageError, Cancelled.
[[nodiscard]] TrajectoryEstimate estimate_trajectories(const std::vector<maps::Drive>& drives,
                                                       const TrajectoryOptions& options,
                                                       const std::filesystem::path& scratch,
                                                       const ProgressCallback& progress,
                                                       const CancelFlag& cancel,
                                                       const ScanReader& read = {});

}  // namespace stillmap::mapping
