#include "detection/voxelnext/pruning.hpp"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <stdexcept>
#include <string>

namespace stillmap::mapping {

namespace {

void check_share(double share) {
  if (!(share >= 0.0 && share < 1.0)) {
    throw std::invalid_argument("voxelnext config: pruning: found " + std::to_string(share) +
                                ", expected a share in [0, 1)");
  }
}

/// Sum of |feature|, in one fixed order that vectors of any width can take.
float magnitude(const FeatureRows& rows, std::size_t row) {
  std::array<float, FeatureRows::kLine> sums{};
  const float* values = rows.row(row);
  for (std::size_t begin = 0; begin < rows.channels(); begin += sums.size()) {
    const std::size_t count = std::min(sums.size(), rows.channels() - begin);
    for (std::size_t c = 0; c < count; ++c) sums[c] += std::abs(values[begin + c]);
  }
  for (std::size_t half = sums.size() / 2; half > 0; half /= 2) {
    for (std::size_t c = 0; c < half; ++c) sums[c] += sums[c + half];
  }
  return sums[0];
}

}  // namespace

void check_pruning(const VoxelNextPruning& pruning) { std::ranges::for_each(pruning, check_share); }

std::vector<std::uint8_t> find_dilating(const FeatureRows& rows, double share) {
  check_share(share);
  std::vector<std::uint8_t> out(rows.rows(), 1);
  const auto pruned = static_cast<std::size_t>(share * static_cast<double>(rows.rows()));
  if (pruned == 0) return out;
  // Bits of floats >= 0 are in the order of the floats, and that of NaN (whose features nobody can
  // use) above them. Below them the row, so that no two are equal and one order is possible.
  std::vector<std::uint64_t> keys(rows.rows());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, keys.size(), 4096), [&](const auto& range) {
    for (std::size_t row = range.begin(); row < range.end(); ++row) {
      keys[row] = std::uint64_t{std::bit_cast<std::uint32_t>(magnitude(rows, row))} << 32U |
                  (0xFFFFFFFFU - static_cast<std::uint32_t>(row));
    }
  });
  std::ranges::nth_element(keys, keys.begin() + static_cast<std::ptrdiff_t>(pruned));
  for (std::size_t k = 0; k < pruned; ++k) {
    out[0xFFFFFFFFU - static_cast<std::uint32_t>(keys[k] & 0xFFFFFFFFU)] = 0;
  }
  return out;
}

}  // namespace stillmap::mapping
