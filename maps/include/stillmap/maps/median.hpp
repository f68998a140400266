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

/// The value that this share [0, 1] of one value or more lie below. Changes their order.
template <typename Number>
[[nodiscard]] Number quantile(std::vector<Number>& values, double share) {
  const auto at =
      values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

/// From the median of absolute normal errors to their deviation.
inline constexpr double kMedianToDeviation = 1.4826;

}  // namespace stillmap::maps
