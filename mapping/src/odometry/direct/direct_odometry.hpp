#pragma once

#include <stillmap/mapping/odometry.hpp>

#include <memory>

namespace stillmap::mapping {

/// The method `default`: each scan is aligned with the voxels of what was seen lately
/// (`localization::LocalMap`), from where constant velocity predicts it. The search is as wide as
/// predictions were off lately (adaptive threshold of KISS-ICP: Vizzo et al., RA-L 2023, eq. 6 and
/// 7; ours is the robust kernel's first width, deviations are rates, and rotation counts at 15 m
/// instead of the sensor's range). Directions that a scan does not tell come from the prediction.
/// Scans with point times are deskewed by the predicted twist, aligned, deskewed by the corrected
/// one and aligned again.
[[nodiscard]] std::unique_ptr<Odometry> make_direct_odometry();

}  // namespace stillmap::mapping
