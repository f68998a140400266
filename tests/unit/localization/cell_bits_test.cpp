#include "index/cell_bits.hpp"

#include <gtest/gtest.h>

#include <support/synthetic_world.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace stillmap::localization {
namespace cell_bits_test {

/// Not near the border of two metres, where the float of the bit's number rounds.
double some_height(test::Random& random) { return std::floor(random.uniform(0.0, 30.0)) + 0.5; }

std::vector<Voxel> some_voxels() {
  test::Random random(9);
  std::vector<Voxel> voxels(4000);
  for (Voxel& voxel : voxels) {
    // Two far corners, so that most tiles hold nothing.
    const double x = random.uniform(0.0, 50.0) + (random.uniform() < 0.5 ? 0.0 : 150.0);
    voxel.mean = Eigen::Vector3d(x, random.uniform(0.0, 100.0), some_height(random)).cast<float>();
  }
  return voxels;
}

/// By the definition: a voxel of the column whose metre of height is next to p's.
unsigned expected_hit(const std::vector<Voxel>& voxels, const Eigen::Vector3f& p, float edge_m) {
  if (p.x() < 0.0F || p.y() < 0.0F) return 0;
  const auto cell = [](float c, float edge) { return static_cast<int>(std::floor(c / edge)); };
  return std::any_of(voxels.begin(), voxels.end(), [&](const Voxel& v) {
    return cell(v.mean.x(), edge_m) == cell(p.x(), edge_m) &&
           cell(v.mean.y(), edge_m) == cell(p.y(), edge_m) &&
           std::abs(cell(v.mean.z(), 1.0F) - cell(p.z(), 1.0F)) <= 1;
  });
}

CellBitsTable table_of(const std::vector<Voxel>& voxels, float edge_m) {
  CellBitsTable table(edge_m);
  for (const Voxel& voxel : voxels) table.add(voxel);
  return table;
}

/// The grid of a region without neighbours.
CellBits in_the_middle(const CellBitsTable& table, float edge_m) {
  const CellBits::Part part{.tiles = table.tiles(), .words = table.words(), .x = 1, .y = 1};
  return {edge_m, {&part, 1}};
}

/// Whether one point is hit.
unsigned hit(const CellBits& bits, const Eigen::Vector3f& p) {
  PointColumns one(1);
  one.set(0, p);
  return bits.hits(one, Eigen::Vector3f::Zero());
}

TEST(CellBits, HitWhereAVoxelIsNear) {
  const std::vector<Voxel> voxels = some_voxels();
  for (const float edge_m : kPlaceGridEdgesM) {
    const CellBitsTable table = table_of(voxels, edge_m);
    const CellBits bits = in_the_middle(table, edge_m);
    test::Random random(2);
    unsigned hits = 0;
    for (int k = 0; k < 4000; ++k) {
      const Eigen::Vector3f p(static_cast<float>(random.uniform(-5.0, 200.0)),
                              static_cast<float>(random.uniform(-5.0, 100.0)),
                              static_cast<float>(some_height(random)));
      ASSERT_EQ(hit(bits, p), expected_hit(voxels, p, edge_m)) << p.transpose();
      ASSERT_EQ(bits.column(p.x(), p.y()) >> (CellBits::height_bit(p.z()) % 64U) & 1U,
                hit(bits, p));
      hits += hit(bits, p);
    }
    EXPECT_GT(hits, 40U);
    EXPECT_LT(hits, 3000U);
  }
}

TEST(CellBits, AShiftCountsAsIfThePointsHadMoved) {
  const float edge_m = kPlaceGridEdgesM.front();
  const CellBitsTable table = table_of(some_voxels(), edge_m);
  const CellBits bits = in_the_middle(table, edge_m);
  test::Random random(3);
  for (int k = 0; k < 300; ++k) {
    const Eigen::Vector3f p(static_cast<float>(random.uniform(0.0, 200.0)),
                            static_cast<float>(random.uniform(0.0, 100.0)),
                            static_cast<float>(some_height(random)));
    // Whole metres, so that the sums are exact.
    const Eigen::Vector3f shift(static_cast<float>(std::round(random.uniform(-30.0, 30.0))),
                                static_cast<float>(std::round(random.uniform(-30.0, 30.0))),
                                static_cast<float>(std::round(random.uniform(-5.0, 5.0))));
    PointColumns one(1);
    one.set(0, p);
    ASSERT_EQ(bits.hits(one, shift), hit(bits, p + shift)) << p.transpose();
  }
}

TEST(CellBits, OnlyTilesThatHoldSomethingTakeMemory) {
  const CellBitsTable table = table_of(some_voxels(), 1.0F);
  // Of the 20 x 20 tiles those of the two far corners.
  EXPECT_EQ(table.words().size(), (20 + 1) * 32 * 32);
}

TEST(CellBits, NothingIsHitOutside) {
  const CellBitsTable table = table_of(some_voxels(), 2.0F);
  const CellBits bits = in_the_middle(table, 2.0F);
  EXPECT_EQ(hit(bits, Eigen::Vector3f(-0.5F, 50.0F, 5.0F)), 0U);
  EXPECT_EQ(hit(bits, Eigen::Vector3f(203.0F, 50.0F, 5.0F)), 0U);
  EXPECT_EQ(hit(bits, Eigen::Vector3f(50.0F, 103.0F, 5.0F)), 0U);
}

TEST(CellBits, APointMayLieInANeighbour) {
  std::vector<Voxel> voxels(1);
  voxels[0].mean = Eigen::Vector3f(639.5F, 3.5F, 3.5F);
  const CellBitsTable table = table_of(voxels, 2.0F);
  const CellBits::Part parts[] = {{.tiles = table.tiles(), .words = table.words(), .x = 0, .y = 2},
                                  {.tiles = table.tiles(), .words = table.words(), .x = 1, .y = 1}};
  const CellBits bits(2.0F, parts);
  EXPECT_EQ(hit(bits, Eigen::Vector3f(639.5F, 3.5F, 3.5F)), 1U);
  EXPECT_EQ(hit(bits, Eigen::Vector3f(-0.5F, 643.5F, 3.5F)), 1U);
  EXPECT_EQ(hit(bits, Eigen::Vector3f(-0.5F, 3.5F, 3.5F)), 0U);
  // Columns outside of all regions hold nothing.
  for (const float far_m : {-640.5F, 1280.5F, 1e30F, -1e9F, std::nanf("")}) {
    EXPECT_EQ(bits.column(far_m, 3.5F), 0U);
    EXPECT_EQ(bits.column(3.5F, far_m), 0U);
  }
}

}  // namespace cell_bits_test
}  // namespace stillmap::localization
