#pragma once

#include "drives/drive_set.hpp"
#include "fusion/apply_edits.hpp"
#include "fusion/object_fusion.hpp"
#include "ground/ground_footprint.hpp"
#include "pipeline/scan_work.hpp"

#include <stillmap/maps/map_object.hpp>

#include <cstdint>
#include <map>
#include <vector>

namespace stillmap::mapping {

/// The objects of a build, and where they are in each scan.
struct BuildObjects {
  std::vector<FusedObject> objects;
  /// By ordinal of the scan.
  std::vector<std::vector<ScanObject>> by_scan;
  /// By ordinal: regions in which a user wants every point to stay; lidar frame of the scan.
  std::vector<std::vector<maps::Box>> kept_by_scan;
  EditResult edits;
};

struct Build;

/// Objects as they lie in each scan.
[[nodiscard]] BuildObjects in_scans(const Build& build, std::vector<FusedObject> objects,
                                    EditResult edits);

/// Where objects stood still, in the local frame.
[[nodiscard]] std::vector<GroundFootprint> footprints_of(const std::vector<FusedObject>& objects,
                                                         const Eigen::Vector3d& origin);

/// As the package holds them.
/// @param points_removed  by number of the object plus 1.
/// @param fused           false: nothing is known of their motion.
[[nodiscard]] std::vector<maps::MapObject> to_map_objects(
    const DriveSet& drives, const std::vector<FusedObject>& objects,
    const std::map<std::uint32_t, std::uint64_t>& points_removed, bool fused);

}  // namespace stillmap::mapping
