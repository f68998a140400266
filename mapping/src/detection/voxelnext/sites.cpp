#include "detection/voxelnext/sites.hpp"

#include <bit>
#include <stdexcept>
#include <string>

namespace stillmap::mapping {

namespace {

/// 64 MB of bits; a grid of 200 m x 200 m x 8 m with voxels of 10 cm has 2^28.
constexpr double kMostCells = 0x1p29;

}  // namespace

SiteSet::SiteSet(const Triple& grid) : grid_(grid) {
  const double cells = static_cast<double>(grid.x) * grid.y * grid.z;
  if (!(grid.x > 0 && grid.y > 0 && grid.z > 0 && cells <= kMostCells)) {
    throw std::invalid_argument("voxel grid: found " + std::to_string(grid.x) + " x " +
                                std::to_string(grid.y) + " x " + std::to_string(grid.z) +
                                " cells, expected 1 to 2^29");
  }
  words_in_line_ = (static_cast<std::size_t>(grid.x) + 63) / 64;
  bits_.resize(first_word(0, grid.y));
  is_marked_.resize(line_of(0, grid.y));
  before_ = std::make_unique_for_overwrite<std::uint32_t[]>(bits_.size());
}

void SiteSet::number_sites() {
  sites_.clear();
  lines_.clear();
  line_begin_.clear();
  line_begin_.reserve(is_marked_.size() + 1);
  for (int y = 0; y < grid_.y; ++y) {
    for (int z = 0; z < grid_.z; ++z) {
      const auto begin = static_cast<std::uint32_t>(sites_.size());
      line_begin_.push_back(begin);
      if (is_marked_[line_of(z, y)] == 0) continue;
      const std::size_t first = first_word(z, y);
      for (std::size_t k = 0; k < words_in_line_; ++k) {
        before_[first + k] = static_cast<std::uint32_t>(sites_.size());
        for (std::uint64_t rest = bits_[first + k]; rest != 0; rest &= rest - 1)
          sites_.push_back({z, y, static_cast<int>(64 * k) + std::countr_zero(rest)});
      }
      const auto end = static_cast<std::uint32_t>(sites_.size());
      if (begin != end) lines_.push_back({z, y, begin, end});
    }
  }
  line_begin_.push_back(static_cast<std::uint32_t>(sites_.size()));
}

std::uint32_t SiteSet::find(const Triple& cell) const {
  if (!contains(cell)) return kNone;
  const std::size_t word = word_of(cell);
  const std::uint64_t bit = bit_of(cell.x);
  if ((bits_[word] & bit) == 0) return kNone;
  return before_[word] + static_cast<std::uint32_t>(std::popcount(bits_[word] & (bit - 1)));
}

}  // namespace stillmap::mapping
