#pragma once

#include "map_level.hpp"

#include <cstdint>
#include <vector>

namespace stillmap::localization {

/// Which cells of a map hold anything: a 64-bit word a column, a bit a metre of height. Heights
/// count modulo 64 m, so that hills need no more; what lies 64 m higher in one column counts as the
/// same.
class CellBits {
 public:
  /// @param level    of the index, its cells about 1 m. @param extent  of the index [m].
  /// @param edge_m   of a column. @param spread  columns around, to each side, whose bits are taken
  ///                 over too.
  CellBits(const MapIndex::Level& level, const Eigen::Vector3d& extent, float edge_m, int spread);

  [[nodiscard]] float edge_m() const { return edge_m_; }
  /// 1 where something lies within a metre of this height [m, relative to the index's origin].
  [[nodiscard]] unsigned hit(const Eigen::Vector3f& p) const {
    const auto x = static_cast<std::int32_t>(p.x() * inverse_edge_);
    const auto y = static_cast<std::int32_t>(p.y() * inverse_edge_);
    // Negative coordinates round towards zero, onto the first column; there is nothing beside it.
    if (p.x() < 0.0F || p.y() < 0.0F || x >= columns_ || y >= rows_) return 0;
    const auto z = static_cast<std::uint32_t>(static_cast<std::int32_t>(p.z() + kBelow));
    return static_cast<unsigned>(
               words_[static_cast<std::size_t>(y) * static_cast<std::size_t>(columns_) +
                      static_cast<std::size_t>(x)] >>
               (z % 64U)) &
           1U;
  }

 private:
  /// A multiple of 64 that keeps heights positive.
  static constexpr float kBelow = 64.0F * 1024.0F;

  float edge_m_;
  float inverse_edge_;
  std::int32_t columns_;
  std::int32_t rows_;
  std::vector<std::uint64_t> words_;
};

}  // namespace stillmap::localization
