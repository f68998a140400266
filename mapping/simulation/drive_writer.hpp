#pragma once

#include <stillmap/maps/box.hpp>
#include <stillmap/maps/partial_folder.hpp>

#include <Eigen/Geometry>

#include <cstddef>
#include <filesystem>
#include <vector>

#include "scanner.hpp"

namespace stillmap::simulation {

/// Writes scans in KITTI odometry's layout; nothing shows at the target before `publish`.
class DriveWriter {
 public:
  /// @throws InputError if `target` exists, StorageError if it cannot be written.
  explicit DriveWriter(const std::filesystem::path& target);

  /// The next scan. @throws StorageError.
  void add(const SimulatedScan& scan, std::vector<maps::Box> boxes,
           const Eigen::Isometry3d& T_world_lidar, double time_s);
  void publish();

 private:
  maps::PartialFolder folder_;
  std::vector<Eigen::Isometry3d> T_world_lidar_;
  std::vector<double> times_s_;
  maps::BoxSequence boxes_;
};

}  // namespace stillmap::simulation
