#include <stillmap/maps/cell_table.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <tuple>
#include <unordered_map>

namespace stillmap::maps {
namespace cell_table_test {

using ::testing::ElementsAre;

TEST(SignedCellKey, IsReadBackAndKeepsTheOrderOfCells) {
  constexpr int kHalf = kCellsPerAxis / 2;
  std::vector<std::array<std::int32_t, 3>> cells;
  for (const int x : {-kHalf, -1, 0, 7, kHalf - 1})
    for (const int y : {-kHalf, -1, 0, 7, kHalf - 1})
      for (const int z : {-kHalf, -1, 0, 7, kHalf - 1}) cells.push_back({x, y, z});
  std::vector<std::uint64_t> keys;
  for (const auto& cell : cells) {
    keys.push_back(signed_cell_key(cell[0], cell[1], cell[2]));
    EXPECT_EQ(signed_cell_of_key(keys.back()), cell);
    EXPECT_LT(keys.back(), std::uint64_t{1} << 63U);
  }
  EXPECT_TRUE(std::is_sorted(keys.begin(), keys.end()));
  EXPECT_EQ(std::adjacent_find(keys.begin(), keys.end()), keys.end());
}

TEST(PlaneCellKey, DiffersForCellsOnAllSidesOfTheOrigin) {
  std::vector<std::uint64_t> keys;
  for (const std::int32_t x : {INT32_MIN, -1, 0, 1, INT32_MAX})
    for (const std::int32_t y : {INT32_MIN, -1, 0, 1, INT32_MAX})
      keys.push_back(plane_cell_key(x, y));
  std::sort(keys.begin(), keys.end());
  EXPECT_EQ(std::adjacent_find(keys.begin(), keys.end()), keys.end());
}

/// Keys in lines and in a heap of collisions, some of them twice.
std::vector<std::uint64_t> many_keys() {
  std::vector<std::uint64_t> keys;
  for (std::int32_t k = 0; k < 3000; ++k) {
    keys.push_back(signed_cell_key(k % 50 - 25, k / 50, -k));
    keys.push_back(std::uint64_t{static_cast<std::uint32_t>(k % 700)} << 32U);
  }
  return keys;
}

TEST(CellTable, NumbersKeysInTheOrderInWhichTheyCame) {
  CellTable table;
  std::unordered_map<std::uint64_t, std::uint32_t> expected;
  for (const std::uint64_t key : many_keys()) {
    const auto [at, is_new] = expected.try_emplace(key, table.size());
    EXPECT_EQ(table.insert(key), std::pair(at->second, is_new));
  }
  EXPECT_EQ(table.size(), expected.size());
  for (const auto& [key, number] : expected) EXPECT_EQ(table.find(key), number);
  EXPECT_FALSE(table.contains(signed_cell_key(0, 0, 1)));
  table.clear();
  EXPECT_EQ(table.size(), 0U);
  for (const auto& [key, number] : expected) EXPECT_FALSE(table.contains(key));
  EXPECT_EQ(table.insert(7), std::pair(0U, true));
}

TEST(CellIndex, NumbersKeysThatTheCallerHolds) {
  CellIndex index;
  std::vector<std::uint64_t> held;
  const auto key_at = [&](std::uint32_t number) { return held[number]; };
  std::unordered_map<std::uint64_t, std::uint32_t> expected;
  for (const std::uint64_t key : many_keys()) {
    const auto [at, is_new] = expected.try_emplace(key, held.size());
    EXPECT_EQ(index.insert(key, key_at), std::pair(at->second, is_new));
    if (is_new) held.push_back(key);
  }
  EXPECT_EQ(index.size(), held.size());
  for (const auto& [key, number] : expected) EXPECT_EQ(index.find(key, key_at), number);
  EXPECT_EQ(index.find(signed_cell_key(0, 0, 1), key_at), CellIndex::kNone);
}

TEST(CellMap, HoldsValuesInTheOrderInWhichCellsCame) {
  CellMap<std::string> map;
  EXPECT_TRUE(map.empty());
  map[plane_cell_key(5, -1)] += "a";
  map[plane_cell_key(-2, 3)] += "b";
  map[plane_cell_key(5, -1)] += "c";
  EXPECT_FALSE(map.insert(plane_cell_key(-2, 3), "other").second);
  EXPECT_TRUE(map.insert(plane_cell_key(0, 0), "d").second);
  std::vector<std::string> values;
  for (const auto& [key, value] : map) values.push_back(value);
  EXPECT_THAT(values, ElementsAre("ac", "b", "d"));
  ASSERT_NE(map.find(plane_cell_key(-2, 3)), nullptr);
  EXPECT_EQ(*map.find(plane_cell_key(-2, 3)), "b");
  EXPECT_EQ(map.find(plane_cell_key(3, -2)), nullptr);
  map.clear();
  EXPECT_EQ(map.size(), 0U);
  EXPECT_EQ(map.find(plane_cell_key(0, 0)), nullptr);
}

}  // namespace cell_table_test
}  // namespace stillmap::maps
