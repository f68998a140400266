#pragma once

#include "ground/ground_footprint.hpp"
#include "ground/ground_smoothing.hpp"

#include <span>

namespace stillmap::mapping {

/// Makes all ground measured under objects suspect, as what lay in boxes is already: where a
/// detector missed the object in some scans, its tyres and sills were taken for ground.
void suspect_ground_under(MeasuredSheets& ground, std::span<const GroundFootprint> footprints);

/// Lays the ground under objects that stood still: where no ray reached, it follows the plane
/// around, or the two planes on either side of a kerb that goes on below the object.
///
/// What remains between that and the measured cells around is spread inward as a membrane that the
/// kerb cuts. Suspects within 4 cm of it become measured ground.
/// @param ground  after `spread_ground`.
void lay_ground_under(MeasuredSheets& ground, std::span<const GroundFootprint> footprints);

}  // namespace stillmap::mapping
