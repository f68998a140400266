#include "index/cell_blocks.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <set>
#include <tuple>
#include <utility>
#include <vector>

#include <support/synthetic_world.hpp>

namespace stillmap::localization {
namespace cell_blocks_test {

using Cell = std::tuple<std::int32_t, std::int32_t, std::int32_t>;

std::int32_t draw(test::Random& random) {
  return static_cast<std::int32_t>(random.uniform(0.0, 24.0));
}

/// A third of the cells of a cube of 24, whose sides lie on a block's border.
std::set<Cell> some_cells() {
  test::Random random(4);
  std::set<Cell> cells;
  while (cells.size() < 4600) cells.insert({draw(random), draw(random), draw(random)});
  return cells;
}

std::vector<CellBlocks::Place> places_of(const std::set<Cell>& cells) {
  std::vector<CellBlocks::Place> places;
  for (const auto& [x, y, z] : cells) places.push_back(CellBlocks::place_of(x, y, z));
  std::sort(places.begin(), places.end());
  return places;
}

/// Cells as a part of an index: each voxel is told by its number of points.
struct Part {
  explicit Part(const std::set<Cell>& cells)
      : places(places_of(cells)), table(places, kTileShift), voxels(places.size()) {
    for (std::uint32_t i = 0; i < voxels.size(); ++i) voxels[i].points = i;
  }
  [[nodiscard]] CellBlocks::Part at(const Eigen::Array3i& first_cell) const {
    return {
        .tiles = table.tiles(), .slots = table.slots(), .voxels = voxels, .first_cell = first_cell};
  }
  [[nodiscard]] std::uint32_t number_of(const Cell& cell) const {
    const auto& [x, y, z] = cell;
    const auto place =
        std::lower_bound(places.begin(), places.end(), CellBlocks::place_of(x, y, z));
    return static_cast<std::uint32_t>(place - places.begin());
  }

  /// Tiles of 8 cells, so that the cube has nine.
  static constexpr int kTileShift = 3;
  std::vector<CellBlocks::Place> places;
  CellBlockTable table;
  std::vector<Voxel> voxels;
};

TEST(CellBlocks, VisitsTheEightCellsAroundAPointWhereverBlocksTilesAndPartsMeet) {
  const std::set<Cell> cells = some_cells();
  const Part part(cells);
  // Two cubes side by side, the second 8 cells higher, and below zero.
  const Eigen::Array3i second(24, 0, 8);
  const Eigen::Array3i first(-24, -24, -40);
  const CellBlocks::Part parts[] = {part.at(first), part.at(first + second)};
  const CellBlocks blocks(parts, Part::kTileShift, 0.5F);
  EXPECT_EQ(blocks.voxel_count(), 2 * cells.size());
  // From beside the first cell, where half of the eight are none.
  for (std::int32_t x = -1; x < 49; ++x) {
    for (std::int32_t y = -1; y < 25; ++y) {
      for (std::int32_t z = -1; z < 34; ++z) {
        std::vector<std::pair<std::uint32_t, float>> expected;
        for (std::int32_t corner = 0; corner < 8; ++corner) {
          const Eigen::Array3i at =
              Eigen::Array3i(x, y, z) + Eigen::Array3i(corner >> 2, (corner >> 1) & 1, corner & 1);
          const bool in_second = at.x() >= 24;
          const Eigen::Array3i own = in_second ? Eigen::Array3i(at - second) : at;
          const Cell cell{own.x(), own.y(), own.z()};
          if (cells.contains(cell))
            expected.emplace_back(part.number_of(cell), in_second ? 0.F : -12.F);
        }
        std::array<CellBlocks::Wanted, 8> wanted;
        const CellBlocks::Wanted* const end =
            blocks.blocks_of_eight(x + first.x(), y + first.y(), z + first.z(), 7, wanted.data());
        std::vector<std::pair<std::uint32_t, float>> visited;
        for (CellBlocks::Wanted* block = wanted.data(); block != end; ++block) {
          EXPECT_EQ(block->point, 7U);
          for (std::uint64_t left = CellBlocks::cells_in(*block); left != 0; left &= left - 1) {
            const std::uint32_t number = CellBlocks::number_of(*block->slot, left & (0 - left));
            visited.emplace_back(block->tile->voxels[number].points, block->tile->corner.x());
          }
        }
        std::sort(visited.begin(), visited.end());
        std::sort(expected.begin(), expected.end());
        ASSERT_EQ(visited, expected) << x << " " << y << " " << z;
      }
    }
  }
}

TEST(CellBlocks, TellsTheCellsNearARectangle) {
  const std::set<Cell> cells = some_cells();
  const Part part(cells);
  const Eigen::Array3i first(16, -8, 4);
  const CellBlocks::Part moved = part.at(first);
  const CellBlocks blocks({&moved, 1}, Part::kTileShift, 0.5F);
  std::set<Cell> met;
  blocks.for_each_near(
      {20, -100}, {29, 100},
      [&](const Eigen::Array3i& cell, const Voxel& voxel, const CellBlocks::TileView& /*tile*/) {
        const Eigen::Array3i own = cell - first;
        const Cell at{own.x(), own.y(), own.z()};
        EXPECT_TRUE(cells.contains(at));
        EXPECT_EQ(voxel.points, part.number_of(at));
        EXPECT_TRUE(met.insert(at).second);
      });
  // Whole blocks: 20 to 31.
  for (const Cell& cell : cells)
    EXPECT_EQ(met.contains(cell), std::get<0>(cell) >= 4 && std::get<0>(cell) < 16);
  blocks.for_each_near({100, 100}, {200, 200}, [&](const auto&...) { ADD_FAILURE(); });
}

TEST(CellBlocks, EmptyOnesHoldNothing) {
  const CellBlocks blocks;
  std::array<CellBlocks::Wanted, 8> wanted;
  EXPECT_EQ(blocks.blocks_of_eight(0, 0, 0, 0, wanted.data()), wanted.data());
}

}  // namespace cell_blocks_test
}  // namespace stillmap::localization
