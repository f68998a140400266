#pragma once

#include <stillmap/mapping/odometry.hpp>

#include <cstdint>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// Places hidden scans, which were predicted from those before them alone, by those after them too.
///
/// Between two visible scans: constant velocity plus the mean acceleration, over more than 3 s
/// constant velocity alone. Before the first visible scan: extrapolated backward from the first
/// two. After the last: unchanged.
/// @param stamps_ns  one a pose, ascending.
void interpolate_hidden(std::span<const std::int64_t> stamps_ns, std::vector<OdometryPose>& poses);

}  // namespace stillmap::mapping
