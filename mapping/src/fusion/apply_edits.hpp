#pragma once

#include "fusion/object_fusion.hpp"

#include <stillmap/maps/box.hpp>
#include <stillmap/maps/edits.hpp>

#include <Eigen/Core>

#include <cstddef>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// A scan as edits name it.
struct EditScan {
  std::string drive;
  /// The drive's own number of it.
  std::size_t index = 0;
  /// Of the sensor; map frame [m].
  Eigen::Vector3d sensor = Eigen::Vector3d::Zero();
  /// Which of the drives: several may have one name.
  std::size_t drive_number = 0;
};

struct EditResult {
  std::size_t applied = 0;
  /// Objects that stay, with the placements they had: no later stage may take their points.
  std::vector<FusedObject> kept;
  /// Descriptions of edits that met nothing: no such object, or no scan that saw the region. To be
  /// shown as warnings.
  std::vector<std::string> unmatched;
};

/// Replays a user's corrections on fused objects.
///
/// - keep object: the objects of such a class that stood within a metre of that place are none any
///   more; one that moved only where no standing one is there.
/// - keep region: placements with their centre in it go. Points of others that reach into it stay
/// by
///   `kept_regions`.
/// - remove object: an object there that fusion doubted is taken all the same.
/// - remove region: what stands in it is removed as an object of unknown class, in the scans within
///   80 m of it; one object a drive.
///
/// In the file's order, so a later edit has the last word.
/// @param scans  one a scan, by ordinal.
/// @throws std::invalid_argument when a placement is of a scan that is not among `scans`.
[[nodiscard]] EditResult apply_edits(FusedObjects& fused, const maps::Edits& edits,
                                     const std::vector<EditScan>& scans);

/// Regions of a scan in which every point stays; map frame.
[[nodiscard]] std::vector<maps::Box> kept_regions(const maps::Edits& edits, const EditScan& scan);

}  // namespace stillmap::mapping
