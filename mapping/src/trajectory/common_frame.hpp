#pragma once

#include <stillmap/maps/drive.hpp>

#include <Eigen/Geometry>

namespace stillmap::mapping {

/// Takes poses of a drive to the frame of the first drive's, by their geodetic origins; exactly the
/// identity where these are the same, or neither has any (one frame, as far as one can know).
/// @throws maps::InputError naming the drive where only one of the two has an origin.
[[nodiscard]] Eigen::Isometry3d T_first_own(const maps::Drive& first, const maps::Drive& drive);

}  // namespace stillmap::mapping
