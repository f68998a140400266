#pragma once

#include "calibration/followed_lidar.hpp"

namespace stillmap::mapping {

struct ClockOffset {
  /// To be added to the lidar's stamps [s].
  double offset_s = 0.0;
  double sigma_s = 0.0;
};

/// From the rates of turn, which do not depend on where a lidar stands or how it is turned: the
/// offset within 0.5 s at which those of both differ least, refined by a parabola. Its deviation is
/// that of ten parts of the drive. Where hardly anything turns, the deviation is 0.5 s.
[[nodiscard]] ClockOffset clock_offset(const FollowedLidar& reference, const FollowedLidar& lidar);

}  // namespace stillmap::mapping
