#include "cell_bits.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

namespace stillmap::localization {

CellBits::CellBits(const MapIndex::Level& level, const Eigen::Vector3d& extent, float edge_m,
                   int spread)
    : edge_m_(edge_m),
      inverse_edge_(1.0F / edge_m),
      columns_(static_cast<std::int32_t>(static_cast<float>(extent.x()) / edge_m) + 1),
      rows_(static_cast<std::int32_t>(static_cast<float>(extent.y()) / edge_m) + 1),
      words_(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_), 0) {
  for (const Voxel& voxel : level.voxels) {
    const auto x = static_cast<std::int32_t>(voxel.mean.x() * inverse_edge_);
    const auto y = static_cast<std::int32_t>(voxel.mean.y() * inverse_edge_);
    const auto z = static_cast<std::uint32_t>(static_cast<std::int32_t>(voxel.mean.z() + kBelow));
    const std::uint64_t bit = std::uint64_t{1} << (z % 64U);
    const std::uint64_t bits = bit | std::rotl(bit, 1) | std::rotr(bit, 1);
    for (std::int32_t row = std::max(0, y - spread); row <= std::min(rows_ - 1, y + spread);
         ++row) {
      for (std::int32_t column = std::max(0, x - spread);
           column <= std::min(columns_ - 1, x + spread); ++column) {
        words_[static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) +
               static_cast<std::size_t>(column)] |= bits;
      }
    }
  }
}

}  // namespace stillmap::localization
