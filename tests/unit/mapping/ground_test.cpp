#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/mapping/ground.hpp>

#include <functional>
#include <numeric>

#include "support/synthetic_world.hpp"

namespace stillmap::mapping {
namespace {

constexpr double kSensorM = 1.8;

/// Rings around the sensor on a surface z = f(x, y) in the lidar frame.
maps::PointCloud rings_on(const std::function<double(double, double)>& z_at) {
  maps::PointCloud cloud;
  for (double range_m = 3.0; range_m < 40.0; range_m *= 1.06) {
    for (int column = 0; column < 720; ++column) {
      const double azimuth = 2.0 * std::numbers::pi * column / 720;
      const double x = range_m * std::cos(azimuth), y = range_m * std::sin(azimuth);
      cloud.positions.push_back(Eigen::Vector3d(x, y, z_at(x, y)).cast<float>());
    }
  }
  return cloud;
}

GroundResult segment(const maps::PointCloud& cloud) {
  return make_ground_segmenter()->segment(cloud);
}

std::size_t count(const GroundResult& ground) {
  return std::accumulate(ground.is_ground.begin(), ground.is_ground.end(), std::size_t{0});
}

double height_at(const GroundResult& ground, double x, double y) {
  const auto sample = ground.surface->at(x, y);
  return sample ? sample->z : std::nan("");
}

maps::PointCloud turned(maps::PointCloud cloud, double yaw_rad) {
  const Eigen::Matrix3f R =
      Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix().cast<float>();
  for (Eigen::Vector3f& p : cloud.positions) p = R * p;
  return cloud;
}

/// Houses, cars and poles on flat ground.
maps::PointCloud street_scan() {
  test::ScanPattern pattern;
  pattern.noise_m = 0.02;
  return test::street(7).scan(test::pose_at(40.0, 0.0), pattern);
}

TEST(Ground, TakesAllOfAFlatFieldAndKnowsItsHeight) {
  const maps::PointCloud cloud = rings_on([](double, double) { return -kSensorM; });
  const GroundResult ground = segment(cloud);
  EXPECT_EQ(count(ground), cloud.size());
  const auto sample = ground.surface->at(7.3, -4.1);
  ASSERT_TRUE(sample);
  EXPECT_NEAR(sample->z, -kSensorM, 1e-3);
  EXPECT_NEAR(sample->normal.z(), 1.0, 1e-6);
  EXPECT_DOUBLE_EQ(sample->confidence, 1.0);
}

TEST(Ground, FollowsASlopeOfEightPercent) {
  const auto slope = [](double x, double y) { return -kSensorM + 0.08 * x - 0.02 * y; };
  const maps::PointCloud cloud = rings_on(slope);
  const GroundResult ground = segment(cloud);
  EXPECT_EQ(count(ground), cloud.size());
  for (const auto& [x, y] : {std::pair{5.0, 5.0}, {20.0, -3.0}, {-25.0, 10.0}, {0.0, 30.0}}) {
    EXPECT_NEAR(height_at(ground, x, y), slope(x, y), 0.02) << x << " " << y;
  }
  const Eigen::Vector3d normal = ground.surface->at(10.0, 0.0)->normal;
  EXPECT_NEAR(-normal.x() / normal.z(), 0.08, 0.005);
  EXPECT_NEAR(-normal.y() / normal.z(), -0.02, 0.005);
}

TEST(Ground, FollowsAHillThatNoPlaneFits) {
  const auto hill = [](double x, double) {
    return -kSensorM + (x > 10.0 ? 0.1 * (x - 10.0) : 0.0);
  };
  const maps::PointCloud cloud = rings_on(hill);
  const GroundResult ground = segment(cloud);
  EXPECT_GT(count(ground), cloud.size() * 99 / 100);
  EXPECT_NEAR(height_at(ground, 30.0, 0.0), 0.2, 0.05);
}

TEST(Ground, FollowsATiltedSensor) {
  Eigen::Isometry3d T_world_lidar = test::pose_at(0.0, 0.0);
  T_world_lidar.rotate(Eigen::AngleAxisd(0.05, Eigen::Vector3d::UnitX()) *
                       Eigen::AngleAxisd(-0.07, Eigen::Vector3d::UnitY()));
  const maps::PointCloud cloud = test::field().scan(T_world_lidar, {});
  const GroundResult ground = segment(cloud);
  EXPECT_GT(count(ground), cloud.size() * 99 / 100);
}

TEST(Ground, KeepsABlockOfThirtyCentimetresAboveTheGround) {
  const auto is_block = [](double x, double y) {
    return std::abs(y - 6.0) < 0.8 && x > 0 && x < 8;
  };
  const maps::PointCloud cloud =
      rings_on([&](double x, double y) { return is_block(x, y) ? -kSensorM + 0.3 : -kSensorM; });
  const GroundResult ground = segment(cloud);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Eigen::Vector3f& p = cloud.positions[i];
    const bool block = is_block(static_cast<double>(p.x()), static_cast<double>(p.y()));
    ASSERT_EQ(ground.is_ground[i] == 0, block) << p.transpose();
  }
  EXPECT_NEAR(height_at(ground, 4.0, 6.0), -kSensorM, 0.02);
}

TEST(Ground, IsNotLiftedBesideAKerb) {
  const GroundResult ground =
      segment(rings_on([](double, double y) { return y > 4.3 ? -kSensorM + 0.15 : -kSensorM; }));
  EXPECT_NEAR(height_at(ground, 6.0, 3.4), -kSensorM, 0.05);
  EXPECT_NEAR(height_at(ground, 6.0, 2.0), -kSensorM, 0.03);
  EXPECT_NEAR(height_at(ground, 6.0, 6.5), -kSensorM + 0.15, 0.05);
}

TEST(Ground, PassesOverReflectionsBelowIt) {
  maps::PointCloud cloud = rings_on([](double, double) { return -kSensorM; });
  test::Random random(3);
  std::vector<bool> below(cloud.size(), false);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    below[i] = random.uniform() < 0.01;
    if (below[i]) cloud.positions[i].z() -= static_cast<float>(random.uniform(0.5, 3.0));
  }
  const GroundResult ground = segment(cloud);
  for (std::size_t i = 0; i < cloud.size(); ++i) ASSERT_EQ(ground.is_ground[i] == 0, below[i]);
  EXPECT_NEAR(height_at(ground, 12.0, 3.0), -kSensorM, 0.02);
}

TEST(Ground, LiesUnderACarWithLessConfidence) {
  test::SyntheticWorld world;
  world.boxes = {{{8.0, 3.0, 0.2}, {12.3, 4.8, 1.5}}};
  const GroundResult ground = segment(world.scan(test::pose_at(0.0, 0.0), {}));
  const auto sample = ground.surface->at(10.5, 4.2);
  ASSERT_TRUE(sample);
  EXPECT_NEAR(sample->z, -kSensorM, 0.05);
  EXPECT_LT(sample->confidence, 1.0);
  EXPECT_GT(sample->confidence, 0.0);
}

TEST(Ground, IsUnknownFarFromAllOfIt) {
  const GroundResult ground = segment(rings_on([](double, double) { return -kSensorM; }));
  EXPECT_FALSE(ground.surface->at(70.0, 0.0));
  EXPECT_FALSE(ground.surface->at(1e6, 0.0));
  EXPECT_FALSE(ground.surface->at(std::nan(""), 0.0));
}

TEST(Ground, TurnsWithTheInput) {
  const maps::PointCloud cloud = street_scan();
  const GroundResult straight = segment(cloud);
  EXPECT_GT(count(straight), cloud.size() / 5);
  for (const double yaw_rad : {0.5 * std::numbers::pi, 0.65, 3.0}) {
    const GroundResult other = segment(turned(cloud, yaw_rad));
    std::size_t differing = 0;
    for (std::size_t i = 0; i < cloud.size(); ++i)
      differing += straight.is_ground[i] != other.is_ground[i] ? 1 : 0;
    EXPECT_LT(differing, cloud.size() / 50) << yaw_rad;
  }
}

TEST(Ground, IsTheSameTwice) {
  const maps::PointCloud cloud = street_scan();
  EXPECT_EQ(segment(cloud).is_ground, segment(cloud).is_ground);
}

TEST(Ground, OfNothingIsEmptyButAsked) {
  const GroundResult ground = segment({});
  EXPECT_TRUE(ground.is_ground.empty());
  ASSERT_TRUE(ground.surface);
  EXPECT_FALSE(ground.surface->at(0.0, 0.0));
}

TEST(Ground, IsNotSeenInTooFewOrEqualPoints) {
  maps::PointCloud few;
  few.positions = {{5, 0, -1.8F}, {0, 5, -1.8F}, {-5, 0, -1.8F}, {0, -5, -1.8F}, {6, 6, -1.8F}};
  EXPECT_EQ(count(segment(few)), 0U);
  maps::PointCloud equal;
  equal.positions.assign(1000, Eigen::Vector3f(5.0F, 2.0F, -1.8F));
  EXPECT_EQ(count(segment(equal)), 0U);
}

TEST(Ground, LeavesOutWhatIsBeyondItsGridOrNotANumber) {
  maps::PointCloud cloud = rings_on([](double, double) { return -kSensorM; });
  const std::size_t known = cloud.size();
  cloud.positions.emplace_back(150.0F, 0.0F, -1.8F);
  cloud.positions.emplace_back(std::nanf(""), 0.0F, -1.8F);
  const GroundResult ground = segment(cloud);
  EXPECT_EQ(ground.is_ground.size(), cloud.size());
  EXPECT_EQ(count(ground), known);
}

}  // namespace
}  // namespace stillmap::mapping
