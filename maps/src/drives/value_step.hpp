#pragma once

#include <span>

namespace stillmap::maps {

/// Largest step such that all values differ by whole multiples of it: found in numbers that were
/// rounded. 0 if there is none, or if even motion explains it.
/// @param values  in the order in which they were taken; finite.
[[nodiscard]] double step_of(std::span<const double> values);

}  // namespace stillmap::maps
