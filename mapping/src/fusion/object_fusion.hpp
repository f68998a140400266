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

/// What fusion made of the boxes.
struct FusedObjects {
  /// By the scan of their first placement.
  std::vector<FusedObject> objects;
  /// Candidates against which more speaks than for them; no objects, unless a user says so.
  std::vector<FusedObject> doubtful;
};

/// Joins the boxes of all scans into objects.
///
/// Boxes of scans that follow each other become tracks (constant velocity, best pairs first); a
/// track that went somewhere, past places that were seen free, is a moving object, smoothed forward
/// and backward; all others are joined by place and stand still, in a box that takes each side from
/// the scans that saw it. Each candidate then has to stand against every scan that saw its place:
/// good views without a box, and rays right through it, speak against it. Objects are of one drive;
/// whether the same car stood there on another day is not asked, but a place seen free then says
/// that this was no part of the street.
/// @param scans  of all drives, in order; a scan's ordinal is its position.
/// @return Same input, same bits.
/// @throws std::invalid_argument for a pose or a box that is not finite, or a box without size,
/// naming scan and box.
/// @see    Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and Navigation",
/// 2001; Thrun, Burgard, Fox, "Probabilistic Robotics", 2005, eq. (4.20) for adding up log odds.
[[nodiscard]] FusedObjects fuse_boxes(const std::vector<DetectedScan>& scans,
                                      const BoxRayCounter& count_rays);

/// Sorts objects by the scan of their first placement, thus by drive, and writes each object's
/// index, class and existence into the boxes of its placements.
void order_objects(std::vector<FusedObject>& objects);

}  // namespace stillmap::mapping
