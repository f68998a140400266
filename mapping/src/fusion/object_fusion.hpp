#pragma once

#include "views/box_rays.hpp"

#include <stillmap/maps/box.hpp>

#include <Eigen/Geometry>

#include <cstddef>
#include <cstdint>
#include <map>
#include <vector>

namespace stillmap::mapping {

/// What detection found in one scan.
struct DetectedScan {
  /// Which of the drives; scans of one drive follow each other.
  std::size_t drive = 0;
  std::int64_t stamp_ns = 0;
  Eigen::Isometry3d T_map_lidar = Eigen::Isometry3d::Identity();
  /// Lidar frame at the stamp. `track` >= 0: given by the detector, the same number is the same
  /// object within one drive.
  std::vector<maps::Box> boxes;
};

/// Where a fused object was at a scan.
struct ObjectPlacement {
  /// Ordinal of the scan, over all drives.
  std::size_t scan = 0;
  /// Map frame; `yaw_rad` too. `track` is the object's index.
  maps::Box box;
  /// False: not detected in that scan, filled in from the others.
  bool detected = true;
};

/// One object over all scans of all drives.
struct FusedObject {
  maps::ObjectClass object_class = maps::ObjectClass::kUnknown;
  /// Length, width, height of the whole object [m].
  Eigen::Vector3d size_m = Eigen::Vector3d::Ones();
  /// Probability that it was there, in [0, 1].
  double existence = 0.0;
  bool moving = false;
  /// One a scan that it may have points in, by scan.
  std::vector<ObjectPlacement> placements;
};

/// Joins the boxes of all scans into objects.
/// @param scans  of all drives, in order; a scan's ordinal is its position.
/// @return in the order of their first scan. Same input, same bits.
[[nodiscard]] std::vector<FusedObject> fuse_objects(const std::vector<DetectedScan>& scans,
                                                    const BoxRayCounter& count_rays);

}  // namespace stillmap::mapping
