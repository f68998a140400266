#pragma once

#include "fusion/sight.hpp"
#include "fusion/standing.hpp"
#include "fusion/track.hpp"

#include <stillmap/maps/box.hpp>

#include <cstddef>
#include <vector>

namespace stillmap::mapping {

/// An object that went somewhere.
struct MovingObject {
  /// Size of the whole object.
  maps::Box box;
  Evidence evidence;
  /// By scan: hits, the scans between them, and some before and after.
  std::vector<ObjectPlacement> placements;
};

/// @param drive_scans  ordinals of all scans of the track's drive, in order.
[[nodiscard]] MovingObject moving_object(const Track& track, const std::vector<DetectedScan>& scans,
                                         const std::vector<std::size_t>& drive_scans,
                                         const SightLines& sight);

}  // namespace stillmap::mapping
