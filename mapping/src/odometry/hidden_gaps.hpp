#pragma once

#include <stillmap/mapping/odometry.hpp>

#include <cstdint>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// Bends the poses of hidden scans, which were predicted from those before them, so that they lead
/// to the scan after them. What a prediction by speed is off by grows with the square of time, as
/// under an even acceleration. Poses of hidden scans at the end stay.
/// @param stamps_ns  one a pose, ascending.
void join_over_hidden(std::span<const std::int64_t> stamps_ns, std::vector<OdometryPose>& poses);

}  // namespace stillmap::mapping
