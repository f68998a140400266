#pragma once

#include "odometry/loam/map_match.hpp"

namespace stillmap::mapping::loam {

/// Covariance of the motion since the scan before: of the match where it tells, of a prediction
/// along the rest.
/// @param match  nothing for a pose that is predicted. @param predicted  scans on end that were.
[[nodiscard]] Matrix6 covariance_of(const MapMatch* match, double period_s, int predicted);

}  // namespace stillmap::mapping::loam
