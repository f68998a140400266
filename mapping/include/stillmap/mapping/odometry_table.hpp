#pragma once

#include <stillmap/mapping/odometry_evaluation.hpp>
#include <stillmap/mapping/paper_evaluation.hpp>
#include <stillmap/mapping/progress.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// What the paper's Table I is made of.
struct OdometryTableOptions {
  /// Streets to simulate, one a seed, no one twice; not empty unless `drives` or `kitti` are given.
  std::vector<std::uint64_t> seeds = {101, 102, 103};
  /// Of each simulated street, in [10, 10000]: the default comes back to where it was.
  std::size_t scans = 1500;
  /// Of a simulated street, as `SimulationOptions::sensor`.
  std::string sensor = "hdl64";
  /// Of a simulated street, as `SimulationOptions::parked_share`.
  std::optional<double> parked_share;
  /// Instead of simulated streets: drives with poses that are taken for the truth.
  std::vector<std::filesystem::path> drives;
  /// Likewise: a folder of KITTI odometry, with `sequences/NN/velodyne/`, `sequences/NN/calib.txt`
  /// and `poses/NN.txt`.
  std::optional<std::filesystem::path> kitti;
  /// Its sequences; empty = those of the paper that are there.
  std::vector<std::string> sequences;
  /// What finds movable objects, a name for `make_detector`.
  std::string detector = "voxelnext";
  /// Out of `odometry_names()`; not empty.
  std::vector<std::string> methods = {"loam", "default"};
  /// In [0, 256], 0 = all cores. The figures do not depend on it.
  int threads = 0;
  /// Which program this is; pieces that another one made are not used again.
  std::string program;

  /// Every broken bound as "name: value, bound"; empty when usable.
  [[nodiscard]] std::vector<std::string> violations() const;
};

/// A street, a drive or a sequence.
struct OdometryTableDrive {
  std::string name;
  std::size_t scans = 0;
  double way_m = 0.0;
  /// What the paper prints for it [m]: without removal, and its method.
  std::optional<std::array<double, 2>> paper_m = std::nullopt;
};

/// Of one path; NaN where the drive is too short to tell.
struct PathFigures {
  double ape_mean_m = 0.0;
  double ate_rmse_m = 0.0;
  double kitti_percent = 0.0;
  double kitti_deg_per_100m = 0.0;
  double percent_10m = 0.0;
  double deg_10m = 0.0;
};

/// One drive followed by one method with one kind of points.
struct OdometryTableRun {
  /// As in `OdometryTable::drives`.
  std::string drive;
  std::size_t scans = 0;
  double way_m = 0.0;
  std::string method;
  MovablePolicy points = MovablePolicy::kKeep;
  PathFigures without_loops, with_loops;
  std::size_t loops_found = 0, loops_right = 0, revisits = 0, revisits_found = 0;
  std::size_t matched = 0, partly = 0, predicted = 0;
  TreatedPoints treated;
  double scans_per_second = 0.0;
};

/// By how much treated points change a path, over the drives.
struct OdometryTableDifference {
  std::string method;
  bool loops = false;
  /// `kProject` or `kDelete`, less `kKeep`.
  MovablePolicy points = MovablePolicy::kProject;
  std::size_t drives = 0;
  /// Drives on which the mean distance became smaller.
  std::size_t better = 0;
  /// Below zero = better than raw points. Student's interval over the drives; NaN bounds of one.
  Interval ape_mean_m;
  Interval percent_10m;
};

struct OdometryTable {
  std::vector<OdometryTableDrive> drives;
  /// By drive, method, points.
  std::vector<OdometryTableRun> runs;
  std::vector<OdometryTableDifference> differences;
  /// Sequences of the paper that the folder does not hold.
  std::vector<std::string> missing;
  double seconds = 0.0;
  OdometryTableOptions options;
};

/// Writes a drive, whole or not at all, to a folder that does not exist: a town street of a seed,
/// with boxes.json and exact poses.
using SimulateStreet = std::function<void(
    const OdometryTableOptions& options, std::uint64_t seed, const std::filesystem::path& target,
    const ProgressCallback& progress, const CancelFlag& cancel)>;

/// The paper's Table I (Woo, Jung, Kim, "No More Potentially Dynamic Objects", section IV): how far
/// a path that odometry follows is off, with the scans as they are, with movable points projected
/// and with them deleted, each without and with loops.
///
/// The paper prints one mean distance in metres and does not say how paths were laid upon the
/// truth; here it is the mean APE after the best rigid motion without scale. KITTI's metric and ATE
/// stand beside it. Poses never enter but as the truth: a row with given poses has no error, which
/// it shows.
///
/// Drives and runs lie in `work` under names that hold a checksum of everything they come from;
/// what is there and whole is used again.
/// @param work  a folder; made if it is not there.
/// @param keep  simulated drives stay too; else each goes when its runs are there.
/// @throws std::invalid_argument (options), maps::InputError for a KITTI folder of another layout,
/// and what simulating and `evaluate_odometry` throw.
[[nodiscard]] OdometryTable evaluate_odometry_table(const OdometryTableOptions& options,
                                                    const SimulateStreet& simulate,
                                                    const std::filesystem::path& work, bool keep,
                                                    const ProgressCallback& progress,
                                                    const CancelFlag& cancel);

/// `raw`, `projected` or `deleted`.
[[nodiscard]] std::string points_name(MovablePolicy points);

/// The object of `--json`. What could not be known is null.
[[nodiscard]] std::string to_json(const OdometryTable& table);

/// A page of `--report`: one HTML file that needs no other, without scripts.
/// @param command  how to make it again; plain text.
[[nodiscard]] std::string to_html(const OdometryTable& table, const std::string& command);

}  // namespace stillmap::mapping
