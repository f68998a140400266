#pragma once

#include "trajectory/path_motions.hpp"
#include "trajectory/smooth_path.hpp"

namespace stillmap::mapping {

/// Within this lag least squares find the way alone.
inline constexpr double kNearLagS = 0.3;

/// Which lag of the given poses' clock makes them move and turn as the scans do: 0, or another
/// where that explains much more. A given pose of t + lag belongs to the scan of t.
/// @param step_s  from lag to lag, of up to 120 s.
[[nodiscard]] double best_lag_s(const PathMotions& motions, const SmoothPath& given, double step_s);

}  // namespace stillmap::mapping
