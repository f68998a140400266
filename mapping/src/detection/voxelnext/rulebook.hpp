#pragma once

#include "detection/voxelnext/sites.hpp"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// Which input row meets which output row under which position of a kernel (the "rulebook" of
/// Graham, Engelcke, van der Maaten, "3D Semantic Segmentation with Submanifold Sparse
/// Convolutional Networks", CVPR 2018, section 3).
///
/// Pairs of one position ascend in both rows, since the order of cells does not change when all
/// are shifted. So tiles of output rows are ranges of pairs, and several threads can each do some.
class Rulebook {
 public:
  /// Output rows that are worked on together: their features stay in the cache.
  static constexpr std::size_t kTileRows = 256;
  struct Pairs {
    const std::uint32_t* in = nullptr;
    const std::uint32_t* out = nullptr;
    std::size_t count = 0;
  };

  Rulebook() = default;
  Rulebook(Rulebook&&) = default;
  Rulebook& operator=(Rulebook&&) = default;

  /// Output cells = input cells; kernel of odd sizes. Half of the positions mirror the others.
  [[nodiscard]] static Rulebook submanifold(const SiteSet& sites, const Triple& kernel);
  /// The same for some output cells only, which become output rows 0, 1, ...
  /// @param rows  numbers of cells, ascending.
  [[nodiscard]] static Rulebook submanifold_at(const SiteSet& sites, const Triple& kernel,
                                               const std::vector<std::uint32_t>& rows);
  /// Each row with itself, a kernel of one position.
  [[nodiscard]] static Rulebook identity(std::size_t rows);
  /// From each output cell, `out * stride - kernel / 2 + position` is the input cell.
  /// @param out  of the grid of `reached_by`; cells that are not in it get no pairs.
  [[nodiscard]] static Rulebook strided(const SiteSet& in, const SiteSet& out, const Triple& kernel,
                                        const Triple& stride);

  [[nodiscard]] std::size_t out_rows() const { return out_rows_; }
  [[nodiscard]] std::size_t tiles() const { return (out_rows_ + kTileRows - 1) / kTileRows; }
  [[nodiscard]] std::size_t kernel_volume() const { return lists_.size(); }
  /// Of all positions.
  [[nodiscard]] std::size_t pair_count() const;
  /// Pairs of a kernel position, row-major over (z, y, x).
  [[nodiscard]] Pairs pairs(std::size_t position) const { return lists_[position]; }
  /// Those whose output row lies in a tile.
  [[nodiscard]] Pairs pairs(std::size_t position, std::size_t tile) const;

 private:
  void find_tiles();

  /// Room for as many pairs as a position can have; only what is used is ever touched.
  using Indices = std::unique_ptr<std::uint32_t[]>;
  static Indices room_for(std::size_t count) {
    return std::make_unique_for_overwrite<std::uint32_t[]>(count);
  }
  static Indices ascending(std::size_t count);

  std::size_t out_rows_ = 0;
  std::vector<Indices> indices_;
  std::vector<Pairs> lists_;
  /// [position][tile]: first pair of the tile.
  std::vector<std::uint32_t> tile_begins_;
};

/// Cells of the grid floor((n + 2 (k / 2) - k) / stride) + 1 with at least one input cell under
/// their kernel.
/// @param dilates  for each input cell 0 where it is enough for an output cell only under the
/// middle of its kernel; none: no such. With stride 2 that takes even z, y and x: an odd cell alone
/// gives no output, and counts in those that others give. (The published program, which does the
/// same, also leaves out output cells at z, y or x = 0, as it happens; here they stay.)
[[nodiscard]] SiteSet reached_by(const SiteSet& in, const Triple& kernel, const Triple& stride,
                                 std::span<const std::uint8_t> dilates = {});

}  // namespace stillmap::mapping
