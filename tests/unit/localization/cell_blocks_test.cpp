#include "index/cell_blocks.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <tuple>
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

TEST(CellBlocks, NumbersCellsInTheOrderOfTheirPlaces) {
  const std::set<Cell> cells = some_cells();
  const std::vector<CellBlocks::Place> places = places_of(cells);
  const CellBlockTable table(places);
  const CellBlocks blocks = table.view();
  for (std::int32_t x = 0; x < 26; ++x) {
    for (std::int32_t y = 0; y < 26; ++y) {
      for (std::int32_t z = 0; z < 26; ++z) {
        const auto place =
            std::lower_bound(places.begin(), places.end(), CellBlocks::place_of(x, y, z));
        const bool there = cells.contains({x, y, z});
        const auto expected =
            there ? static_cast<std::uint32_t>(place - places.begin()) : CellBlocks::kNone;
        ASSERT_EQ(blocks.find(x, y, z), expected) << x << " " << y << " " << z;
      }
    }
  }
}

TEST(CellBlocks, VisitsTheEightCellsAroundAPointWhereverBlocksMeet) {
  const std::set<Cell> cells = some_cells();
  const CellBlockTable table(places_of(cells));
  const CellBlocks blocks = table.view();
  // From beside the grid's first cell, where half of the eight are none.
  for (std::int32_t x = -1; x < 25; ++x) {
    for (std::int32_t y = -1; y < 25; ++y) {
      for (std::int32_t z = -1; z < 25; ++z) {
        std::vector<std::uint32_t> expected;
        for (std::int32_t corner = 0; corner < 8; ++corner) {
          const Cell cell{x + (corner >> 2), y + ((corner >> 1) & 1), z + (corner & 1)};
          if (cells.contains(cell)) {
            expected.push_back(
                blocks.find(std::get<0>(cell), std::get<1>(cell), std::get<2>(cell)));
          }
        }
        std::vector<std::uint32_t> visited;
        const CellBlocks::Numbers numbers = blocks.eight(x, y, z);
        visited.assign(numbers.of.begin(),
                       numbers.of.begin() + static_cast<std::ptrdiff_t>(numbers.count));
        std::sort(visited.begin(), visited.end());
        std::sort(expected.begin(), expected.end());
        ASSERT_EQ(visited, expected) << x << " " << y << " " << z;
      }
    }
  }
}

TEST(CellBlocks, EmptyOnesHoldNothing) {
  const CellBlocks blocks;
  EXPECT_EQ(blocks.find(1, 2, 3), CellBlocks::kNone);
  EXPECT_EQ(blocks.eight(0, 0, 0).count, 0U);
}

}  // namespace cell_blocks_test
}  // namespace stillmap::localization
