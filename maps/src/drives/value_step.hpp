#pragma once

#include <span>

namespace stillmap::maps {

/// The step that all values are multiples apart of, as numbers written with too few digits or
/// rounded to 32-bit floats are; 0 where there is none, or no more than even motion tells.
/// @param values  in the order in which they were taken; finite.
[[nodiscard]] double step_of(std::span<const double> values);

}  // namespace stillmap::maps
