#include <stillmap/localization/local_map.hpp>

#include "index/local_voxels.hpp"

#include <stillmap/localization/map_index.hpp>
#include <stillmap/maps/frames.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <support/index_voxels.hpp>
#include <support/synthetic_world.hpp>

#include <limits>
#include <stdexcept>

namespace stillmap::localization {
namespace local_map_test {

using test::pose_at;
using ::testing::IsEmpty;
using Vector6d = Eigen::Matrix<double, 6, 1>;

test::ScanPattern pattern(std::uint64_t seed) {
  test::ScanPattern out;
  out.rings = 24;
  out.columns = 360;
  out.noise_m = 0.02;
  out.seed = seed;
  return out;
}

/// Points on a slope, and a mark that puts the cells of both maps on the same grid.
std::vector<Eigen::Vector3f> slope(std::uint64_t seed) {
  test::Random random(seed);
  std::vector<Eigen::Vector3f> points = {{-64.0F, -64.0F, -8.0F}};
  for (int k = 0; k < 3000; ++k) {
    const double x = random.uniform(-10, 10), y = random.uniform(-10, 10);
    points.push_back(Eigen::Vector3d(x, y, 0.3 * x + random.normal() * 0.02).cast<float>());
  }
  return points;
}

void expect_same_voxels(std::span<const MapIndex::Level> a, const Eigen::Vector3d& origin_a,
                        std::span<const MapIndex::Level> b, const Eigen::Vector3d& origin_b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t level = 0; level < a.size(); ++level) {
    ASSERT_EQ(a[level].cells.voxel_count(), b[level].cells.voxel_count());
    ASSERT_GT(a[level].cells.voxel_count(), 50U);
    for (const test::FoundVoxel& found : test::voxels_of(a[level])) {
      const Voxel& voxel = *found.voxel;
      const Eigen::Vector3d mean = found.mean.cast<double>() + origin_a;
      const auto nearest = b[level].nearest((mean - origin_b).cast<float>(), 1e-4F);
      ASSERT_NE(nearest.voxel, nullptr);
      const Voxel& other = *nearest.voxel;
      EXPECT_LT((nearest.mean.cast<double>() + origin_b - mean).norm(), 1e-4);
      EXPECT_EQ(other.points, voxel.points);
      EXPECT_EQ(other.sharp_axes, voxel.sharp_axes);
      EXPECT_NEAR(other.variance0, voxel.variance0, 1e-6F);
      EXPECT_NEAR(other.variance2, voxel.variance2, 1e-6F);
      EXPECT_NEAR(std::abs(other.axis0.dot(voxel.axis0)), 1.0F, 1e-3F);
    }
  }
}

TEST(LocalVoxels, AreThoseOfAMapIndexOfTheSamePoints) {
  LocalVoxels grown;
  std::vector<Eigen::Vector3d> all;
  for (std::uint64_t scan = 0; scan < 3; ++scan) {
    const std::vector<Eigen::Vector3f> points = slope(scan);
    grown.add(points, Eigen::Isometry3d::Identity(), 200.0);
    for (const Eigen::Vector3f& p : points) all.push_back(p.cast<double>());
  }
  const auto index = MapIndex::build(all);
  const auto window = index->around(Eigen::Vector3d::Zero());
  expect_same_voxels(window->levels(), window->origin(), grown.levels(), grown.origin());
}

TEST(LocalVoxels, StayTheSameWhenTheOriginFollowsTheSensor) {
  LocalVoxels still, followed;
  still.add(slope(1), Eigen::Isometry3d::Identity(), 200.0);
  followed.add(slope(1), Eigen::Isometry3d::Identity(), 200.0);
  for (double x = 0.0; x < 100.0; x += 12.0) followed.add({}, pose_at(x, -0.7 * x), 200.0);
  EXPECT_GT((followed.origin() - still.origin()).norm(), 80.0);
  expect_same_voxels(still.levels(), still.origin(), followed.levels(), followed.origin());
}

TEST(LocalMap, ForgetsWhatIsOutOfReachSoThatMemoryIsBounded) {
  const test::SyntheticWorld world = test::street(5, 400.0);
  LocalMap map;
  std::size_t most = 0;
  for (double x = 0.0; x <= 400.0; x += 8.0) {
    const Eigen::Isometry3d T = pose_at(x, 0.0);
    map.add(world.scan(T, pattern(1)).positions, T);
    if (x < 200.0) most = std::max(most, map.voxel_count());
  }
  EXPECT_LT(map.voxel_count(), most + most / 4);
  map.add({}, pose_at(1e7, 0.0));
  EXPECT_EQ(map.voxel_count(), 0U);
}

TEST(LocalMap, FindsAScanFromANearAndAFarGuess) {
  const test::SyntheticWorld world = test::street(6);
  LocalMap map;
  for (double x = 40.0; x <= 60.0; x += 1.0)
    map.add(world.scan(pose_at(x, 0.0), pattern(static_cast<std::uint64_t>(x))).positions,
            pose_at(x, 0.0));
  const Eigen::Isometry3d T = pose_at(55.5, 0.4, 0.05);
  const std::vector<Eigen::Vector3f> points = world.scan(T, pattern(99)).positions;
  const auto off = [&](const Eigen::Isometry3d& found) {
    return (T.inverse() * found).translation().norm();
  };
  EXPECT_LT(off(map.refined(points, T * pose_at(0.15, -0.1, 0.01, 0.05), 0.3)), 0.01);
  EXPECT_LT(off(map.refined(points, T * pose_at(0.8, -0.4, 0.04, 0.1), 1.0)), 0.01);
  const Eigen::Isometry3d far = map.searched(points, T * pose_at(4.0, -2.0, 0.2, 0.0));
  EXPECT_LT(off(map.refined(points, far, 0.6)), 0.01);
  const LocalAlignment match = map.judged(points, T);
  EXPECT_THAT(match.degenerate_directions, IsEmpty());
  EXPECT_GT(match.known_inlier_ratio, 0.9);
  EXPECT_GT(match.fit, 1.5 * map.judged(points, T * pose_at(0.8, -0.4, 0.04, 0.1)).fit);
}

TEST(LocalMap, RefusesNumbersThatAreNotFinite) {
  LocalMap map;
  const std::vector<Eigen::Vector3f> points = slope(1);
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation().x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(map.add(points, T), std::invalid_argument);
  EXPECT_THROW((void)map.refined(points, T, 0.3), std::invalid_argument);
  EXPECT_THROW((void)map.refined(points, Eigen::Isometry3d::Identity(),
                                 std::numeric_limits<double>::quiet_NaN()),
               std::invalid_argument);
  EXPECT_THROW((void)map.judged(points, T), std::invalid_argument);
}

TEST(LocalMap, AnEmptyMapAnswersTheGuess) {
  const LocalMap map;
  const Eigen::Isometry3d T = pose_at(3.0, 4.0);
  EXPECT_TRUE(map.refined(slope(1), T, 0.3).isApprox(T));
  EXPECT_TRUE(map.searched(slope(1), T).isApprox(T));
  EXPECT_EQ(map.judged(slope(1), T).matched, 0U);
}

}  // namespace local_map_test
}  // namespace stillmap::localization
