#pragma once

#include <Eigen/Core>

#include <stillmap/maps/cell_table.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace stillmap::mapping::reference {

/// One bit for each voxel of a block of 8 x 8 x 8: a word for each z, in it bit y * 8 + x.
using BlockBits = std::array<std::uint64_t, 8>;

[[nodiscard]] inline std::uint64_t column_bit(const Eigen::Vector3i& voxel) {
  return std::uint64_t{1} << static_cast<unsigned>((voxel.y() & 7) * 8 + (voxel.x() & 7));
}
[[nodiscard]] inline Eigen::Vector3i block_of(const Eigen::Vector3i& voxel) {
  return {voxel.x() >> 3, voxel.y() >> 3, voxel.z() >> 3};
}

/// Where blocks of 8 x 8 x 8 voxels are: numbers 0, 1, ... in the order in which they were asked
/// for. A hash table finds chunks of 8 x 8 x 8 blocks, a table in each chunk the blocks.
class BlockIndex {
 public:
  /// The chunk that was asked for last: neighbours are mostly in it.
  struct Hint {
    std::uint64_t key = ~std::uint64_t{0};
    std::uint32_t chunk = 0;
  };

  static constexpr std::uint32_t kNone = 0xFFFFFFFF;
  /// Blocks are within this of zero on each axis.
  static constexpr int kLimit = 1 << 23;

  /// @return the number of a block; size() before the call for one that is new.
  /// @param hint  of this index, since its last clear().
  std::uint32_t add(const Eigen::Vector3i& block, Hint& hint);
  /// @return kNone for a block that was never added. Safe from several threads.
  [[nodiscard]] std::uint32_t find(const Eigen::Vector3i& block) const;
  /// Forgets the blocks but keeps the memory.
  void clear();

  [[nodiscard]] std::size_t size() const { return blocks_.size(); }
  [[nodiscard]] const Eigen::Vector3i& block(std::size_t number) const { return blocks_[number]; }

 private:
  using Chunk = std::array<std::uint32_t, 512>;
  std::uint32_t chunk_for(std::uint64_t key);

  maps::CellTable table_{500};
  std::vector<Chunk> chunks_;
  std::vector<Eigen::Vector3i> blocks_;
};

}  // namespace stillmap::mapping::reference
