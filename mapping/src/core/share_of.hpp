#pragma once

#include <cstddef>
#include <limits>

namespace stillmap::mapping {

/// part / whole; NaN where there is nothing to count: neither all nor none is gone.
[[nodiscard]] inline double share_of(std::size_t part, std::size_t whole) {
  if (whole == 0) return std::numeric_limits<double>::quiet_NaN();
  return static_cast<double>(part) / static_cast<double>(whole);
}

}  // namespace stillmap::mapping
