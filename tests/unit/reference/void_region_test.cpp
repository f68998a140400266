#include "reference/void_region.hpp"

#include "reference/block_grid.hpp"
#include "reference/scan_space.hpp"
#include "reference/voxel_ray.hpp"
#include "support/synthetic_world.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <limits>
#include <set>
#include <tuple>
#include <vector>

namespace stillmap::mapping::reference {
namespace void_region_test {

using Voxel = std::tuple<int, int, int>;
using test::Random;

Voxel tuple_of(const Eigen::Vector3i& v) { return {v.x(), v.y(), v.z()}; }

Eigen::Vector3d point_in(Random& random, double from, double to) {
  const double x = random.uniform(from, to);
  const double y = random.uniform(from, to);
  return {x, y, random.uniform(from, to)};
}

std::set<Voxel> walked(const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  VoxelRay ray(from, to);
  Eigen::Vector3i voxel = voxel_of(from);
  std::set<Voxel> voxels{tuple_of(voxel)};
  for (int left = ray.steps(); left > 0; --left) {
    const int axis = ray.advance();
    voxel[axis] += ray.sign(axis);
    voxels.insert(tuple_of(voxel));
  }
  return voxels;
}

/// Whether a segment passes through the inside of a voxel: the slabs of its three axes overlap.
bool crosses(const Eigen::Vector3d& from, const Eigen::Vector3d& to, const Eigen::Vector3i& voxel) {
  double enter = 0.0, leave = 1.0;
  for (int axis = 0; axis < 3; ++axis) {
    const double way = to[axis] - from[axis];
    const double a = (voxel[axis] - from[axis]) / way;
    const double b = (voxel[axis] + 1 - from[axis]) / way;
    enter = std::max(enter, std::min(a, b));
    leave = std::min(leave, std::max(a, b));
  }
  return enter < leave;
}

std::set<Voxel> crossed(const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  std::set<Voxel> voxels;
  const Eigen::Vector3i low = voxel_of(from.cwiseMin(to)), high = voxel_of(from.cwiseMax(to));
  for (int z = low.z(); z <= high.z(); ++z) {
    for (int y = low.y(); y <= high.y(); ++y) {
      for (int x = low.x(); x <= high.x(); ++x) {
        const Eigen::Vector3i voxel(x, y, z);
        if (crosses(from, to, voxel)) voxels.insert(tuple_of(voxel));
      }
    }
  }
  return voxels;
}

TEST(VoxelRay, MeetsTheVoxelsThatASearchOfAllFinds) {
  Random random(1);
  for (int k = 0; k < 200; ++k) {
    const Eigen::Vector3d from = point_in(random, -6.0, 6.0), to = point_in(random, -6.0, 6.0);
    ASSERT_EQ(walked(from, to), crossed(from, to)) << from.transpose() << " to " << to.transpose();
  }
}

TEST(VoxelRay, FollowsAnAxisAndStandsStill) {
  EXPECT_EQ(walked({0.5, 0.5, 0.5}, {-2.5, 0.5, 0.5}),
            (std::set<Voxel>{{0, 0, 0}, {-1, 0, 0}, {-2, 0, 0}, {-3, 0, 0}}));
  EXPECT_EQ(walked({0.5, 0.5, 0.5}, {0.5, 0.5, 0.5}), (std::set<Voxel>{{0, 0, 0}}));
  // From a border downward the first voxel is left at once.
  EXPECT_EQ(walked({1.0, 0.5, 0.5}, {-0.5, 0.5, 0.5}),
            (std::set<Voxel>{{1, 0, 0}, {0, 0, 0}, {-1, 0, 0}}));
}

TEST(BlockIndex, NumbersBlocksInTheOrderOfAsking) {
  BlockIndex index;
  BlockIndex::Hint hint;
  std::vector<Eigen::Vector3i> blocks;
  for (int k = -3000; k < 3000; k += 7) blocks.emplace_back(k, -2 * k, k / 3);
  blocks.emplace_back(BlockIndex::kLimit - 1, -BlockIndex::kLimit, 0);
  for (std::size_t i = 0; i < blocks.size(); ++i) ASSERT_EQ(index.add(blocks[i], hint), i);
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    ASSERT_EQ(index.find(blocks[i]), i);
    ASSERT_EQ(index.add(blocks[i], hint), i);
    ASSERT_EQ(index.block(i), blocks[i]);
  }
  EXPECT_EQ(index.find({0, 0, 17}), BlockIndex::kNone);
  EXPECT_EQ(index.size(), blocks.size());
}

TEST(BlockIndex, ForgetsAll) {
  BlockIndex index;
  BlockIndex::Hint hint;
  EXPECT_EQ(index.add({1, 2, 3}, hint), 0U);
  index.clear();
  EXPECT_EQ(index.find({1, 2, 3}), BlockIndex::kNone);
  BlockIndex::Hint after;
  EXPECT_EQ(index.add({4, 5, 6}, after), 0U);
  EXPECT_EQ(index.size(), 1U);
}

struct Marks {
  std::set<Voxel> free, hit;
};

Marks marks_of(const ScanSpace& space) {
  Marks marks;
  for (std::size_t i = 0; i < space.size(); ++i) {
    for (int k = 0; k < 512; ++k) {
      const Eigen::Vector3i inside(k & 7, (k >> 3) & 7, k >> 6);
      const auto z = static_cast<std::size_t>(inside.z());
      const Voxel voxel = tuple_of(8 * space.position(i) + inside);
      if ((space.block(i).free[z] & column_bit(inside)) != 0) marks.free.insert(voxel);
      if ((space.block(i).hit[z] & column_bit(inside)) != 0) marks.hit.insert(voxel);
    }
  }
  return marks;
}

TEST(DufomapRay, IsHitOnItsLastMetresAndFreeBefore) {
  ScanSpace space;
  const ScanRays rays{{0.5, 0.5, 0.5}, {{10, 0, 0}}};
  mark_hits(rays, 2.0, space);
  mark_free(rays, 1, space);
  const Marks marks = marks_of(space);
  EXPECT_EQ(marks.hit, (std::set<Voxel>{{8, 0, 0}, {9, 0, 0}, {10, 0, 0}}));
  std::set<Voxel> expected;
  for (int x = 0; x <= 9; ++x) expected.insert({x, 0, 0});
  EXPECT_EQ(marks.free, expected) << "to the first hit voxel and one beyond";
}

TEST(DufomapRay, EndsAtTheHitVoxelsOfOtherRays) {
  ScanSpace space;
  const ScanRays rays{{0.5, 0.5, 0.5}, {{-5, 0, 0}, {-20, 0, 0}}};
  mark_hits(rays, 0.0, space);
  mark_free(rays, 0, space);
  const Marks marks = marks_of(space);
  EXPECT_EQ(marks.hit, (std::set<Voxel>{{-5, 0, 0}, {-20, 0, 0}}));
  EXPECT_EQ(marks.free.size(), 6U);
  EXPECT_TRUE(marks.free.contains({-5, 0, 0}));
  EXPECT_FALSE(marks.free.contains({-6, 0, 0}));
}

TEST(DufomapRay, ShorterThanTheHitDistanceIsHitFromTheSensorOn) {
  ScanSpace space;
  const ScanRays rays{{0.5, 0.5, 0.5}, {{3, 0, 0}}};
  mark_hits(rays, 20.0, space);
  EXPECT_EQ(marks_of(space).hit, (std::set<Voxel>{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}}));
}

/// 0 unknown, 1 free, 2 hit.
class States {
 public:
  explicit States(const Marks& marks) : states_(64 * 64 * 64, 0) {
    for (const Voxel& voxel : marks.free) states_[place(voxel)] = 1;
    for (const Voxel& voxel : marks.hit) states_[place(voxel)] = 2;
  }
  [[nodiscard]] int at(const Eigen::Vector3i& voxel) const {
    return states_[place(tuple_of(voxel))];
  }

 private:
  static std::size_t place(const Voxel& voxel) {
    const auto [x, y, z] = voxel;
    return static_cast<std::size_t>(((z + 32) * 64 + y + 32) * 64 + x + 32);
  }
  std::vector<int> states_;
};

bool is_void(const States& states, const Eigen::Vector3i& voxel, int reach) {
  if (states.at(voxel) != 1) return false;
  for (int z = -reach; z <= reach; ++z) {
    for (int y = -reach; y <= reach; ++y) {
      for (int x = -reach; x <= reach; ++x) {
        if (states.at(voxel + Eigen::Vector3i(x, y, z)) == 0) return false;
      }
    }
  }
  return true;
}

/// Three blocks a side, most voxels free or hit, so that void regions cross the blocks' borders.
ScanSpace random_space(double unknown_share, std::uint64_t seed) {
  Random random(seed);
  ScanSpace space;
  for (int k = 0; k < 24 * 24 * 24; ++k) {
    ScanCursor cursor(space, {k % 24 - 9, (k / 24) % 24 - 8, k / 576 - 7});
    const double draw = random.uniform();
    if (draw < unknown_share) continue;
    if (draw < 0.9) cursor.set_free();
    if (draw > 0.85) cursor.set_hit();
  }
  return space;
}

TEST(VoidRegion, IsWhatItsDefinitionSaysForEveryReach) {
  for (const int reach : {0, 1, 2, 4, 7}) {
    const ScanSpace space = random_space(reach == 0 ? 0.2 : 0.05 / (reach * reach * reach), 3);
    const States states(marks_of(space));
    int found = 0;
    for (std::size_t i = 0; i < space.size(); ++i) {
      const BlockBits bits = void_region(space, i, reach);
      for (int k = 0; k < 512; ++k) {
        const Eigen::Vector3i inside(k & 7, (k >> 3) & 7, k >> 6);
        const bool is = (bits[static_cast<std::size_t>(inside.z())] & column_bit(inside)) != 0;
        ASSERT_EQ(is, is_void(states, 8 * space.position(i) + inside, reach)) << reach;
        found += is ? 1 : 0;
      }
    }
    EXPECT_GT(found, 100) << reach;
  }
}

TEST(ScanRays, CastsOneRayAVoxel) {
  PosedScan scan;
  scan.T_local_lidar.translation() = Eigen::Vector3d(100.0, -20.0, 3.0);
  scan.positions = {{1.01F, 0.0F, 0.0F}, {1.09F, 0.05F, 0.02F}, {1.11F, 0.0F, 0.0F}};
  ScanSpace space;
  ScanRays rays;
  take_rays(
      scan, 0.1, space, [](std::size_t) { return true; }, rays);
  ASSERT_EQ(rays.ends.size(), 2U);
  EXPECT_EQ(rays.ends[0], Eigen::Vector3i(1010, -200, 30));
  EXPECT_EQ(rays.ends[1], Eigen::Vector3i(1011, -200, 30));
}

TEST(ScanRays, LeavesOutWhatNoLidarReaches) {
  PosedScan scan;
  scan.positions = {{3.0e30F, 0.0F, 0.0F}, {501.0F, 0.0F, 0.0F}, {499.0F, 0.0F, 0.0F}};
  ScanSpace space;
  ScanRays rays;
  take_rays(
      scan, 0.1, space, [](std::size_t) { return true; }, rays);
  EXPECT_EQ(rays.ends.size(), 1U);
}

TEST(ScanRays, RefusesPosesBeyondTheVoxels) {
  ScanSpace space;
  ScanRays rays;
  PosedScan scan;
  for (const double x : {1e9, -1e9, std::numeric_limits<double>::quiet_NaN()}) {
    scan.T_local_lidar.translation().x() = x;
    EXPECT_THROW(take_rays(
                     scan, 0.1, space, [](std::size_t) { return true; }, rays),
                 std::invalid_argument);
  }
}

}  // namespace void_region_test
}  // namespace stillmap::mapping::reference
