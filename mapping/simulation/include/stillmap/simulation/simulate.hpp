#pragma once

#include <stillmap/mapping/progress.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::simulation {

/// What is driven through, with which sensor, and how it is written.
struct SimulationOptions {
  /// World to drive through: `town`, streets on a bent grid, each driven twice and in both
  /// directions on a long drive; `city`, the same with more streets: one round leads over all of
  /// them, some 19 km; `highway`; `depot`, a yard with halls, containers and trucks.
  std::string scenario = "town";
  /// Another seed is another world of the same kind.
  std::uint64_t seed = 1;
  /// Same world, other parked cars, other traffic, some leaves more or less; >= 0.
  int day = 1;
  /// Building sites stand where there were none, and some fences are gone.
  bool change = false;
  /// Mean share of the parking places along the roads that are taken, in [0, 1]; none = the
  /// scenario's own (town 0.4).
  std::optional<double> parked_share;
  /// Name of a sensor, or a file that describes one (see mapping/simulation/README.md).
  std::string sensor = "hdl64";
  /// Where the sensor is mounted instead of the usual place above the middle of the vehicle, seen
  /// from there: x forward, y left, z up [m], each within 5; roll, pitch, yaw [deg], each within
  /// 180, applied in this order about fixed axes. Only with the layout `pcd`. Two drives that
  /// differ only in this and in the phase are of two lidars of one vehicle.
  std::array<double, 6> mount{};
  /// How much later each scan is taken [s], in [0, 0.2].
  double phase_s = 0.0;
  /// The vehicle stands beside the lane where it would begin to drive, for the whole drive: all
  /// poses are equal.
  bool standing = false;
  /// What carries the sensor: `vehicle`; `fast`, a vehicle at twice the speed on rough ground;
  /// `hand`, a person who walks beside the lane and looks around.
  std::string carrier = "vehicle";
  /// Also writes `imu.csv`, the readings of an IMU with errors and a clock of its own (see
  /// mapping/simulation/README.md). Layout `pcd` only: the points of the others are at one instant,
  /// or have no times.
  bool imu = false;
  /// Scans driven, at least 1. The whole drive has at most 10000 scans (city: 100000).
  std::size_t scans = 100;
  /// A part of a longer drive: the number of its first scan, counted from 0, and the scans of the
  /// whole drive (0 = it ends with this part). The part's scans, frame and clock are those of the
  /// whole drive. `first` > 0 only with the layouts `kitti-odometry` and `pcd`, without an IMU.
  std::size_t first = 0;
  std::size_t of = 0;
  /// Takes every N-th of these scans, from the first one on; at least 1. More than 1 only under the
  /// conditions of `first` > 0.
  std::size_t every = 1;
  /// `kitti-odometry`, `kitti-raw` or `pcd`.
  std::string layout = "kitti-odometry";
  /// Also writes what only a simulator knows: `truth/`.
  bool truth = false;
  /// Threads that cast rays, 0 to 1024; 0 takes all there are. The bytes are the same for any
  /// number.
  int threads = 0;

  /// Every broken bound as "name: found value, expected bound"; empty when usable.
  [[nodiscard]] std::vector<std::string> violations() const;
};

struct SimulationResult {
  std::size_t scans = 0;
  /// Rays cast, and those that came back as points.
  std::size_t rays = 0;
  std::size_t points = 0;
  /// Objects that at least one point of the drive lies on.
  std::size_t parked = 0;
  std::size_t moving = 0;
  /// Length of the path [m].
  double distance_m = 0.0;
  /// Wall clock time, in all and for making the world [s].
  double seconds = 0.0;
  double world_seconds = 0.0;
  /// Of the process so far [MiB].
  double peak_rss_mib = 0.0;
};

/// Simulates a drive and writes it to the folder `target`.
///
/// Every ray is cast at its own time, from where the sensor is then, into a world where traffic has
/// moved on by then. Layouts:
///  - `kitti-odometry`: velodyne/, labels/ (SemanticKITTI), calib.txt, poses.txt (from near the
///    first scan, upright: all days of a world share this frame), times.txt; points
///    are moved to the scan's stamp with the true motion, as that data set's are;
///  - `kitti-raw`: a synced drive with velodyne_points/ as measured and oxts/ with the errors of a
///    GNSS and inertial system, labels/ beside them;
///  - `pcd`: scans/*.pcd as measured, with the fields x y z intensity t ring, and trajectory.txt.
/// With each: boxes.json, the true box of every object that a scan has points on, all around
/// (`track` = instance in the labels; a box encloses its object, wheels and all, upright in the
/// lidar frame), and KITTI tracking labels of what a front camera would see.
///
/// @param progress  called with the stages "world" and "simulate"; may be empty.
/// @throws std::invalid_argument listing every broken option; maps::InputError if `target` exists
///         or the sensor's file is broken; maps::StorageError if it cannot be written;
///         mapping::Cancelled when `cancel` is set. In every such case nothing is left behind.
/// @note   Same options give the same bytes on one instruction set, for any number of threads.
SimulationResult simulate_drive(const std::filesystem::path& target,
                                const SimulationOptions& options,
                                const mapping::ProgressCallback& progress,
                                const mapping::CancelFlag& cancel);

}  // namespace stillmap::simulation
