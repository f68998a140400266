#pragma once

#include "build/scan_stages.hpp"
#include "stacking/static_map.hpp"

#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/trajectory.hpp>

#include <Eigen/Core>

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// Takes processed scans in order and keeps what the package needs of them.
class ScanStack {
 public:
  /// @param drive  where the scans come from; must outlive the stack.
  /// Otherwise as `StaticMap`.
  ScanStack(const maps::Drive& drive, const Eigen::Vector3d& origin, double voxel_size_m)
      : drive_(drive), map_(origin, voxel_size_m) {}

  /// @param scan  of a later index than the one before.
  void add(const ProcessedScan& scan);

  [[nodiscard]] const StaticMap& map() const { return map_; }
  /// Of all scans, in their order.
  [[nodiscard]] const std::vector<maps::MapObject>& objects() const { return objects_; }
  /// One a scan.
  [[nodiscard]] const std::vector<maps::StampedPose>& poses() const { return poses_; }
  /// SHA-256 and name of every scan's file, a line each as `sha256sum` prints it.
  [[nodiscard]] const std::string& sources() const { return sources_; }
  [[nodiscard]] const std::map<std::string, std::uint64_t>& counts() const { return counts_; }
  [[nodiscard]] const std::map<std::string, double>& stage_seconds() const {
    return stage_seconds_;
  }

 private:
  void add_points(const ProcessedScan& scan);

  const maps::Drive& drive_;
  StaticMap map_;
  std::vector<maps::MapObject> objects_;
  std::vector<maps::StampedPose> poses_;
  std::string sources_;
  std::map<std::string, std::uint64_t> counts_;
  std::map<std::string, double> stage_seconds_;
};

}  // namespace stillmap::mapping
