#include "evaluation/labels/voxel_means.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <map>
#include <stdexcept>

#include "support/synthetic_world.hpp"

namespace stillmap::mapping {
namespace voxel_means_test {

TEST(VoxelMeans, AreTheMeansOfWhatFellIntoEachVoxel) {
  VoxelMeans voxels(0.1);
  voxels.add({0.02F, 0.05F, 0.05F});
  voxels.add({-0.02F, 0.05F, 0.05F});
  voxels.add({0.06F, 0.05F, 0.05F});
  const auto means = voxels.take();
  ASSERT_EQ(means.size(), 2U);
  EXPECT_NEAR(means[0].x(), 0.04F, 1e-6F);
  EXPECT_NEAR(means[1].x(), -0.02F, 1e-6F);
  EXPECT_EQ(voxels.size(), 0U);
  EXPECT_TRUE(voxels.take().empty());
}

TEST(VoxelMeans, StayExactForManyPointsFarAway) {
  VoxelMeans voxels(0.1);
  for (int i = 0; i < 100000; ++i) voxels.add({1000.02F, -2000.03F, i % 2 == 0 ? 0.01F : 0.09F});
  const auto means = voxels.take();
  ASSERT_EQ(means.size(), 1U);
  EXPECT_LT((means[0] - Eigen::Vector3f(1000.02F, -2000.03F, 0.05F)).norm(), 3e-4F);
}

TEST(VoxelMeans, GrowWithoutLosingAVoxel) {
  VoxelMeans voxels(0.2);
  test::Random random(5);
  std::map<std::array<int, 3>, int> cells;
  for (int i = 0; i < 20000; ++i) {
    const Eigen::Vector3f p =
        Eigen::Vector3d(random.uniform(-3, 3), random.uniform(-3, 3), random.uniform(-3, 3))
            .cast<float>();
    const Eigen::Array3d cell = (p.cast<double>().array() * (1.0 / 0.2)).floor();
    ++cells[{static_cast<int>(cell[0]), static_cast<int>(cell[1]), static_cast<int>(cell[2])}];
    voxels.add(p);
  }
  EXPECT_EQ(voxels.take().size(), cells.size());
}

TEST(VoxelMeans, RefuseAnEdgeThatIsNone) {
  EXPECT_THROW(VoxelMeans(0.0), std::invalid_argument);
  EXPECT_THROW(VoxelMeans(std::numeric_limits<double>::quiet_NaN()), std::invalid_argument);
}

}  // namespace voxel_means_test
}  // namespace stillmap::mapping
