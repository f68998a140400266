#pragma once

#include <Eigen/Geometry>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>

#include "geometry/mesh.hpp"
#include "sensing/simulated_scan.hpp"

namespace stillmap::simulation {

/// Layouts that a drive can be written in.
enum class OutputLayout { kKittiOdometry, kKittiRaw, kPcd };

struct DriveWriterOptions {
  OutputLayout layout = OutputLayout::kKittiOdometry;
  /// Writes the truth that no recording has: `truth/`.
  bool truth = true;
  double period_s = 0.1;
  /// Of everything that is drawn here (GNSS and inertial errors).
  std::uint64_t key = 0;
  /// Sensor over ground, where it stands on a vehicle [m].
  double lidar_height_m = 1.73;
  /// Writes `imu.csv`.
  bool imu = false;
  /// Frame of KITTI odometry's poses, asked for at the first scan; empty = the lidar's at its
  /// stamp.
  std::function<Eigen::Isometry3d()> T_world_map;
};

/// Writes a drive; nothing shows at the target before `publish`.
class DriveWriter {
 public:
  /// @throws maps::InputError if `target` exists, maps::StorageError if it cannot be written.
  DriveWriter(const std::filesystem::path& target, const DriveWriterOptions& options,
              TruePath T_world_lidar);
  ~DriveWriter();

  /// The next scan. @throws maps::StorageError.
  void add(const SimulatedScan& scan);
  /// @param ground  the world's ground that stays, in the world's frame.
  void publish(const Mesh& ground);

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace stillmap::simulation
