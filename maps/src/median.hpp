#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

namespace stillmap::maps {

/// Of one value or more; the upper of two in the middle.
template <typename Number>
[[nodiscard]] Number median(std::vector<Number> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace stillmap::maps
