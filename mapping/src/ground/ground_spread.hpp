#pragma once

#include "ground/ground_smoothing.hpp"

namespace stillmap::mapping {

/// Lets the ground spread over cells that were not measured, up to 10 m but not beyond the blocks
/// next to measured ones, then irons it.
///
/// Each ring of cells takes height and slope from the planes of those inside of it, so that a
/// slope goes on as a slope; where fronts meet, the ironing evens them out.
void spread_ground(MeasuredSheets& ground);

/// Takes suspects that agree with what spread there as measured, within 3 cm and 1 cm a cell of
/// distance to the ground around.
/// @return how many.
std::size_t accept_suspects(MeasuredSheets& ground);

}  // namespace stillmap::mapping
