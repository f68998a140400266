#pragma once

#include <stillmap/mapping/progress.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace stillmap::simulation {

/// What is driven through, and with which sensor.
struct SimulationOptions {
  /// World to drive through: `town`, a street with a bend, between buildings.
  std::string scenario = "town";
  /// Another seed is another world of the same kind.
  std::uint64_t seed = 1;
  /// Same world, other parked cars and other traffic; >= 0.
  int day = 1;
  /// `hdl64`, `os1-64` or `vlp16`.
  std::string sensor = "hdl64";
  /// Scans taken, ten a second at some 8 m/s; 1 to 10000.
  std::size_t scans = 100;
  /// Threads that cast rays, 0 to 1024; 0 takes all there are. The bytes are the same for any
  /// number.
  int threads = 0;

  /// Every broken bound as "name: found value, expected bound"; empty when usable.
  [[nodiscard]] std::vector<std::string> violations() const;
};

struct SimulationReport {
  std::size_t scans = 0;
  /// Rays cast, and those that came back as points.
  std::size_t rays = 0;
  std::size_t points = 0;
  /// Objects that at least one point of the drive lies on.
  std::size_t parked = 0;
  std::size_t moving = 0;
  /// Length of the path [m].
  double distance_m = 0.0;
  /// Wall clock time [s].
  double seconds = 0.0;
};

/// Simulates a drive and writes it to the folder `target`, in the layout of KITTI odometry:
///
///  - `velodyne/NNNNNN.bin` x y z intensity, lidar frame (x forward, y left, z up, 1.73 m above the
///  road);
///    rings from the top one down, in each ring counter-clockwise from forward; no-returns are left
///    out;
///  - `calib.txt` (`Tr`: camera from lidar, as a KITTI car has it), `poses.txt` (camera frame,
///  first scan =
///    identity), `times.txt` [s, relative];
///  - `labels/NNNNNN.label` in SemanticKITTI's classes, instance in the upper 16 bits;
///  - `boxes.json`: the true box of every object that the scan has a point on, all around (format
///  of
///    `maps/box.hpp`; `track` = instance). A box encloses its object, wheels and all, upright in
///    the lidar frame.
///
/// Each scan is taken at one instant: there is no motion within it to take out.
/// Range noise is Gaussian, 2 cm, along the ray.
///
/// @param progress  called with stage "simulate" after every scan; may be empty.
/// @throws std::invalid_argument listing every broken option; maps::InputError if `target` exists;
///         maps::StorageError if it cannot be written; mapping::Cancelled when `cancel` is set. In
///         every such case nothing is left behind.
/// @note   Same options give the same bytes on one instruction set, for any number of threads.
SimulationReport simulate_drive(const std::filesystem::path& target,
                                const SimulationOptions& options,
                                const mapping::ProgressCallback& progress,
                                const mapping::CancelFlag& cancel);

}  // namespace stillmap::simulation
