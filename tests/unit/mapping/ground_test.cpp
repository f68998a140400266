#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/mapping/ground.hpp>

#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <numeric>
#include <stdexcept>
#include <vector>

#include "support/synthetic_world.hpp"

namespace stillmap::mapping {
namespace ground_test {

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

/// Share of true ground points (known by the world's flat ground at z = 0) that are found, and
/// share of the others that are taken for ground.
struct Shares {
  double found = 0.0, taken = 0.0;
};

Shares shares(const maps::PointCloud& cloud, const GroundResult& ground,
              const Eigen::Isometry3d& T_world_lidar, double noise_m = 0.0) {
  double truly = 0, found = 0, others = 0, taken = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const double z = (T_world_lidar * cloud.positions[i].cast<double>()).z();
    const bool truth = z < 0.02 + 3.0 * noise_m;
    (truth ? truly : others) += 1;
    (truth ? found : taken) += ground.is_ground[i];
  }
  return {found / std::max(1.0, truly), taken / std::max(1.0, others)};
}

void expect_finite(const GroundSurface& surface) {
  for (double x = -100.5; x < 101.0; x += 1.7) {
    for (double y = -100.5; y < 101.0; y += 1.7) {
      const auto sample = surface.at(x, y);
      if (!sample) continue;
      ASSERT_TRUE(std::isfinite(sample->z) && sample->normal.allFinite());
      ASSERT_NEAR(sample->normal.norm(), 1.0, 1e-9);
      ASSERT_TRUE(sample->confidence > 0.0 && sample->confidence <= 1.0);
    }
  }
}

TEST(Ground, IsFoundBySparseAndDenseSensors) {
  const Eigen::Isometry3d T_world_lidar = test::pose_at(40.0, 0.0);
  for (const int rings : {16, 64, 128}) {
    test::ScanPattern pattern;
    pattern.rings = rings;
    pattern.columns = 600;
    pattern.lowest_rad = rings == 16 ? -0.26 : -0.43;
    pattern.noise_m = 0.01;
    const maps::PointCloud cloud = test::street(7).scan(T_world_lidar, pattern);
    const GroundResult ground = segment(cloud);
    const Shares share = shares(cloud, ground, T_world_lidar, pattern.noise_m);
    EXPECT_GT(share.found, 0.98) << rings;
    EXPECT_LT(share.taken, 0.03) << rings;
    expect_finite(*ground.surface);
  }
}

TEST(Ground, IsFoundFromAnyHeightOfTheSensor) {
  for (const double height_m : {0.6, 1.2, 2.0, 3.0}) {
    const Eigen::Isometry3d T_world_lidar = test::pose_at(40.0, 0.0, 0.0, height_m);
    test::ScanPattern pattern;
    pattern.noise_m = 0.01;
    const maps::PointCloud cloud = test::street(7).scan(T_world_lidar, pattern);
    const GroundResult ground = segment(cloud);
    EXPECT_GT(shares(cloud, ground, T_world_lidar, 0.01).found, 0.98) << height_m;
    EXPECT_NEAR(height_at(ground, 5.0, 0.0), -height_m, 0.03) << height_m;
  }
}

TEST(Ground, IsFoundWhereTheLowestBeamMeetsItFarAway) {
  // A VLP-16 on a bus, a lorry, a mast: its first ring is 13 to 22 m away.
  for (const double height_m : {3.6, 4.5, 6.0}) {
    const Eigen::Isometry3d T_world_lidar = test::pose_at(40.0, 0.0, 0.0, height_m);
    test::ScanPattern pattern;
    pattern.rings = 16;
    pattern.columns = 1800;
    pattern.lowest_rad = -0.262;
    pattern.highest_rad = 0.262;
    pattern.noise_m = 0.01;
    const maps::PointCloud cloud = test::street(7).scan(T_world_lidar, pattern);
    const GroundResult ground = segment(cloud);
    const Shares share = shares(cloud, ground, T_world_lidar, 0.01);
    EXPECT_GT(share.found, 0.95) << height_m;
    EXPECT_LT(share.taken, 0.03) << height_m;
  }
}

TEST(Ground, IsNotFoundAtAHeightThatIsNotTheGivenOne) {
  const maps::PointCloud cloud = street_scan();
  EXPECT_GT(count(make_ground_segmenter({1.9})->segment(cloud)), cloud.size() / 5);
  EXPECT_EQ(count(make_ground_segmenter({3.5})->segment(cloud)), 0U);
}

TEST(Ground, RefusesAHeightThatIsNone) {
  for (const double height_m : {0.0, -1.8, std::nan(""), std::numeric_limits<double>::infinity()})
    EXPECT_THROW((void)make_ground_segmenter({height_m}), std::invalid_argument) << height_m;
}

TEST(Ground, RemembersTheHeightThatItLearned) {
  // A roof terrace below, seen through a gap: 4 m down and all that this scan shows.
  const maps::PointCloud lower = rings_on([](double, double) { return -4.0; });
  const auto segmenter = make_ground_segmenter();
  EXPECT_EQ(count(segmenter->segment(lower)), lower.size());
  for (int k = 0; k < 3; ++k) segmenter->learn(street_scan());
  EXPECT_EQ(count(segmenter->segment(lower)), 0U);
  EXPECT_GT(count(segmenter->segment(street_scan())), street_scan().size() / 5);
}

TEST(Ground, LearnsNothingFromAScanWithoutGround) {
  const auto segmenter = make_ground_segmenter();
  for (int k = 0; k < 10; ++k) segmenter->learn({});
  EXPECT_EQ(segmenter->segment(street_scan()).is_ground, segment(street_scan()).is_ground);
}

TEST(Ground, IsTheSameInAnyOrderOnceLearned) {
  std::vector<maps::PointCloud> scans;
  for (const double x : {20.0, 40.0, 60.0}) {
    test::ScanPattern pattern;
    pattern.noise_m = 0.02;
    scans.push_back(test::street(7).scan(test::pose_at(x, 0.0), pattern));
  }
  const auto a = make_ground_segmenter(), b = make_ground_segmenter();
  for (const maps::PointCloud& scan : scans) {
    a->learn(scan);
    b->learn(scan);
  }
  const auto first = a->segment(scans[0]).is_ground;
  (void)b->segment(scans[2]);
  EXPECT_EQ(b->segment(scans[0]).is_ground, first);
}

TEST(Ground, IsTheSameWithoutIntensities) {
  maps::PointCloud cloud = street_scan();
  const auto without = segment(cloud).is_ground;
  cloud.intensities.assign(cloud.size(), 0.3F);
  EXPECT_EQ(segment(cloud).is_ground, without);
}

TEST(Ground, PassesOverManyReflectionsBelowIt) {
  // Five in a hundred, down to 3 m: two and more in most cells near the sensor.
  maps::PointCloud cloud = rings_on([](double, double) { return -kSensorM; });
  test::Random random(3);
  std::size_t below = 0;
  for (Eigen::Vector3f& p : cloud.positions) {
    if (random.uniform() >= 0.05) continue;
    p.z() -= static_cast<float>(random.uniform(0.5, 3.0));
    ++below;
  }
  const GroundResult ground = segment(cloud);
  EXPECT_EQ(count(ground), cloud.size() - below);
  EXPECT_NEAR(height_at(ground, 12.0, 3.0), -kSensorM, 0.02);
}

TEST(Ground, OfATunnelIsItsFloorAlone) {
  test::SyntheticWorld tunnel = test::corridor();
  tunnel.boxes.push_back({{-300.0, -5.0, 4.0}, {300.0, 5.0, 5.0}});
  const Eigen::Isometry3d T_world_lidar = test::pose_at(0.0, 0.0);
  test::ScanPattern pattern;
  pattern.highest_rad = 0.5;
  pattern.rings = 64;
  const maps::PointCloud cloud = tunnel.scan(T_world_lidar, pattern);
  const Shares share = shares(cloud, segment(cloud), T_world_lidar);
  EXPECT_GT(share.found, 0.98);
  EXPECT_LT(share.taken, 0.02);
}

TEST(Ground, OfALowGarageIsItsFloorAlone) {
  test::SyntheticWorld garage = test::room();
  garage.boxes.push_back({{-16.0, -11.0, 2.3}, {16.0, 11.0, 2.8}});
  const Eigen::Isometry3d T_world_lidar = test::pose_at(0.0, 0.0);
  test::ScanPattern pattern;
  pattern.highest_rad = 0.3;
  const maps::PointCloud cloud = garage.scan(T_world_lidar, pattern);
  const Shares share = shares(cloud, segment(cloud), T_world_lidar);
  EXPECT_GT(share.found, 0.98);
  EXPECT_LT(share.taken, 0.02);
}

TEST(Ground, GoesOnUnderABridge) {
  test::SyntheticWorld world;
  world.boxes = {{{10.0, -30.0, 4.5}, {22.0, 30.0, 5.5}},
                 {{10.0, -9.0, 0.0}, {22.0, -8.0, 4.5}},
                 {{10.0, 8.0, 0.0}, {22.0, 9.0, 4.5}}};
  const Eigen::Isometry3d T_world_lidar = test::pose_at(0.0, 0.0);
  test::ScanPattern pattern;
  pattern.highest_rad = 0.4;
  pattern.rings = 64;
  const maps::PointCloud cloud = world.scan(T_world_lidar, pattern);
  const GroundResult ground = segment(cloud);
  const Shares share = shares(cloud, ground, T_world_lidar);
  EXPECT_GT(share.found, 0.99);
  EXPECT_LT(share.taken, 0.02);
  EXPECT_NEAR(height_at(ground, 16.0, 0.0), -kSensorM, 0.02);
}

TEST(Ground, IsNoneWhereOnlyWallsAreSeen) {
  test::SyntheticWorld walls = test::room();
  walls.has_ground = false;
  const maps::PointCloud cloud = walls.scan(test::pose_at(0.0, 0.0), {});
  ASSERT_GT(cloud.size(), 1000U);
  EXPECT_LT(count(segment(cloud)), cloud.size() / 100);
}

TEST(Ground, IsNoneAboveTheSensor) {
  EXPECT_EQ(count(segment(rings_on([](double, double) { return 1.5; }))), 0U);
}

TEST(Ground, HoldsBothSidesOfAKerb) {
  const maps::PointCloud cloud =
      rings_on([](double, double y) { return y > 4.3 ? -kSensorM + 0.15 : -kSensorM; });
  const GroundResult ground = segment(cloud);
  EXPECT_GT(count(ground), cloud.size() * 995 / 1000);
}

TEST(Ground, LeavesTheFeetOfWallsOut) {
  const maps::PointCloud cloud = [] {
    maps::PointCloud out = rings_on([](double, double) { return -kSensorM; });
    std::erase_if(out.positions, [](const Eigen::Vector3f& p) { return p.y() > 8.0F; });
    return out;
  }();
  maps::PointCloud walled = cloud;
  for (float x = -15.0F; x < 15.0F; x += 0.05F) {
    for (float z = 0.0F; z < 3.0F; z += 0.1F) walled.positions.emplace_back(x, 8.02F, -1.8F + z);
  }
  const GroundResult ground = segment(walled);
  for (std::size_t i = cloud.size(); i < walled.size(); ++i) {
    const float above = walled.positions[i].z() + 1.8F;
    if (above > 0.07F) {
      ASSERT_EQ(ground.is_ground[i], 0) << walled.positions[i].transpose();
    }
  }
}

TEST(Ground, FollowsTheBankBesideARoad) {
  const auto bank = [](double, double y) {
    return -kSensorM - (y > 6.0 ? 0.3 * std::min(y - 6.0, 4.0) : 0.0);
  };
  const maps::PointCloud cloud = rings_on(bank);
  const GroundResult ground = segment(cloud);
  EXPECT_GT(count(ground), cloud.size() * 97 / 100);
  EXPECT_NEAR(height_at(ground, 3.0, 8.5), bank(3.0, 8.5), 0.05);
  // One ring a cell: the slope across it comes round within some metres.
  EXPECT_NEAR(height_at(ground, 3.0, 14.0), bank(3.0, 14.0), 0.06);
}

TEST(Ground, IsFoundInTheNarrowViewOfASolidStateSensor) {
  // Some 5,000 points in 70 by 77 degrees without rings.
  test::Random random(11);
  const Eigen::Isometry3d T_world_lidar = test::pose_at(40.0, 0.0, 0.2, 1.3);
  const test::SyntheticWorld world = test::street(7);
  maps::PointCloud cloud;
  for (int i = 0; i < 9000; ++i) {
    const double azimuth = random.uniform(-0.61, 0.61), elevation = random.uniform(-0.67, 0.67);
    const Eigen::Vector3d direction(std::cos(elevation) * std::cos(azimuth),
                                    std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
    const double range_m =
        world.cast(T_world_lidar.translation(), T_world_lidar.linear() * direction);
    if (range_m < 80.0) cloud.positions.push_back((range_m * direction).cast<float>());
  }
  const GroundResult ground = segment(cloud);
  const Shares share = shares(cloud, ground, T_world_lidar);
  EXPECT_GT(share.found, 0.98);
  EXPECT_LT(share.taken, 0.03);
  expect_finite(*ground.surface);
}

}  // namespace ground_test
}  // namespace stillmap::mapping
