#include "map_level.hpp"

#include <limits>

// Compiled once for each instruction set; the best one is chosen when the program runs.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "index/map_level.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace stillmap::localization::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// Blocks of cells around points, and pairs of a point and a voxel that may be its own.
struct Found {
  static constexpr std::size_t kMost = 8 * MapIndex::Level::kBatch;
  std::array<CellBlocks::Wanted, kMost> blocks;
  /// x, y, z of the block's point from the corner of the block's part [m]; 0.
  alignas(16) std::array<std::array<float, 4>, kMost> from_corner;

  std::size_t count = 0;
  // Room for four more: some are written ahead of the count.
  std::array<const Voxel*, kMost + 4> voxel;
  std::array<std::uint32_t, kMost + 4> block;
  alignas(16) std::array<float, kMost> distance2;
};

#if HWY_TARGET == HWY_SCALAR
void measure(Found& found, float floor_m2) {
  for (std::size_t i = 0; i < found.count; ++i) {
    const std::array<float, 4>& p = found.from_corner[found.block[i]];
    found.distance2[i] = mahalanobis2(*found.voxel[i], {p[0], p[1], p[2]}, floor_m2);
  }
}
#else
/// Four rows of four floats, as columns.
template <class D, class V = hn::Vec<D> >
HWY_INLINE std::array<V, 4> transposed(D d, V r0, V r1, V r2, V r3) {
  const V low02 = hn::InterleaveLower(d, r0, r2), low13 = hn::InterleaveLower(d, r1, r3);
  const V high02 = hn::InterleaveUpper(d, r0, r2), high13 = hn::InterleaveUpper(d, r1, r3);
  return {hn::InterleaveLower(d, low02, low13), hn::InterleaveUpper(d, low02, low13),
          hn::InterleaveLower(d, high02, high13), hn::InterleaveUpper(d, high02, high13)};
}

/// As `mahalanobis2`. No sum is fused, so that all instruction sets give the same bits.
void measure(Found& found, float floor_m2) {
  const hn::Full128<float> d;
  using V = hn::Vec<decltype(d)>;
  const V floor = hn::Set(d, floor_m2);
  // The last vector is filled up with its last pair.
  for (std::size_t i = found.count; i % 4 != 0; ++i) {
    found.voxel[i] = found.voxel[i - 1];
    found.block[i] = found.block[i - 1];
  }
  for (std::size_t i = 0; i < found.count; i += 4) {
    const auto voxels = [&](std::size_t first) HWY_ATTR {
      const auto row = [&](std::size_t k) HWY_ATTR {
        return hn::Load(d, reinterpret_cast<const float*>(found.voxel[i + k]) + first);
      };
      return transposed(d, row(0), row(1), row(2), row(3));
    };
    const auto point = [&](std::size_t k) HWY_ATTR {
      return hn::Load(d, found.from_corner[found.block[i + k]].data());
    };
    const auto [p_x, p_y, p_z, unused] = transposed(d, point(0), point(1), point(2), point(3));
    const auto [mean_x, mean_y, mean_z, a_x] = voxels(0);
    const auto [a_y, a_z, b_x, b_y] = voxels(4);
    const auto [b_z, variance0, variance1, variance2] = voxels(8);
    const V x = hn::Sub(p_x, mean_x), y = hn::Sub(p_y, mean_y), z = hn::Sub(p_z, mean_z);
    const auto along = [&](V axis_x, V axis_y, V axis_z) HWY_ATTR {
      return hn::Add(hn::Add(hn::Mul(axis_x, x), hn::Mul(axis_y, y)), hn::Mul(axis_z, z));
    };
    const V a = along(a_x, a_y, a_z), b = along(b_x, b_y, b_z);
    const V a2 = hn::Mul(a, a), b2 = hn::Mul(b, b);
    const V rest = hn::Sub(hn::Sub(along(x, y, z), a2), b2);
    const V rest2 = hn::IfThenElseZero(hn::Gt(rest, hn::Zero(d)), rest);
    const auto share = [&](V square, V variance)
                           HWY_ATTR { return hn::Div(square, hn::Add(variance, floor)); };
    hn::Store(hn::Add(hn::Add(share(a2, variance0), share(b2, variance1)), share(rest2, variance2)),
              d, &found.distance2[i]);
  }
}
#endif

/// Four steps, each over many points: the processor mispredicts few branches, and the memory that
/// the next step reads is asked for.
void find_nearest(const CellBlocks& cells, float edge_m, std::span<const Eigen::Vector3f> points,
                  float floor_m2, MapIndex::Level::Nearest* nearest) {
  Found found;
  CellBlocks::Wanted* end = found.blocks.data();
  for (std::uint32_t i = 0; i < points.size(); ++i)
    end = blocks_near(cells, 1.0F / edge_m, points[i], i, end);

  const auto block_count = static_cast<std::uint32_t>(end - found.blocks.data());
  for (std::uint32_t k = 0; k < block_count; ++k) {
    CellBlocks::Wanted& block = found.blocks[k];
    const CellBlocks::TileView& tile = *block.tile;
    const Eigen::Vector3f p = points[block.point] - tile.corner;
    found.from_corner[k] = {p.x(), p.y(), p.z(), 0.0F};
    std::uint64_t left = CellBlocks::cells_in(block);
    const CellBlocks::Slot& slot = *block.slot;
    const auto append = [&]() HWY_ATTR {
      const Voxel* voxel = tile.voxels + CellBlocks::number_of(slot, left & (0 - left));
      __builtin_prefetch(voxel);
      found.voxel[found.count] = voxel;
      found.block[found.count] = k;
      found.count += left != 0 ? 1 : 0;
      left &= left - 1;
    };
    if (!CellBlocks::is_whole(tile, slot)) continue;
    // Most have up to four.
    for (int n = 0; n < 4; ++n) append();
    while (left != 0) append();
  }
  measure(found, floor_m2);

  // Distances are not negative, so their bits are in their order. Of equal ones the first is taken.
  const auto rank = [](float distance2, std::uint32_t pair) {
    return std::uint64_t{std::bit_cast<std::uint32_t>(distance2)} << 32 | pair;
  };
  std::array<std::uint64_t, MapIndex::Level::kBatch> best;
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  best.fill(rank(kInfinity, 0));
  for (std::uint32_t i = 0; i < found.count; ++i) {
    std::uint64_t& least = best[found.blocks[found.block[i]].point];
    least = std::min(least, rank(found.distance2[i], i));
  }
  for (std::size_t i = 0; i < points.size(); ++i) {
    nearest[i] = {nullptr, kInfinity};
    if (best[i] == rank(kInfinity, 0)) continue;
    const auto pair = static_cast<std::uint32_t>(best[i]);
    const Voxel* voxel = found.voxel[pair];
    nearest[i] = {voxel, found.distance2[pair],
                  voxel->mean + found.blocks[found.block[pair]].tile->corner};
  }
}

}  // namespace stillmap::localization::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace stillmap::localization {
HWY_EXPORT(find_nearest);

bool MapIndex::Level::has_any_near(const Eigen::Vector3f& p) const {
  std::array<CellBlocks::Wanted, 8> blocks;
  CellBlocks::Wanted* const end = blocks_near(cells, 1.0F / edge_m, p, 0, blocks.data());
  return std::any_of(blocks.data(), end,
                     [](CellBlocks::Wanted& block) { return CellBlocks::cells_in(block) != 0; });
}

void MapIndex::Level::find_nearest(std::span<const Eigen::Vector3f> points, float floor_m2,
                                   Nearest* found) const {
  HWY_DYNAMIC_DISPATCH(find_nearest)(cells, edge_m, points, floor_m2, found);
}

}  // namespace stillmap::localization
#endif  // HWY_ONCE
