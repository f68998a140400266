#pragma once

#include <stillmap/mapping/odometry.hpp>

#include <cstdint>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// Places hidden scans, which were predicted from those before them alone, by those after them too.
///
/// Between two that are seen they lie on the even motion from one to the other, bent by the mean
/// acceleration: from the motion before the first to that behind the second. Over more than 3 s it
/// is even. Hidden scans that a
/// drive begins with follow, backward, from the first two that are seen; those that it ends with
/// stay.
/// @param stamps_ns  one a pose, ascending.
void join_over_hidden(std::span<const std::int64_t> stamps_ns, std::vector<OdometryPose>& poses);

}  // namespace stillmap::mapping
