#include <stillmap/mapping/odometry.hpp>

#include "support/matchers.hpp"
#include "support/synthetic_world.hpp"
#include "support/throws.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/frames.hpp>

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <vector>

namespace stillmap::mapping {
namespace loam_odometry_test {

using test::IsNearPose;
using Vector6 = Eigen::Matrix<double, 6, 1>;
constexpr std::int64_t kPeriodNs = 100'000'000;

test::ScanPattern pattern() {
  test::ScanPattern pattern;
  pattern.rings = 32;
  pattern.columns = 900;
  return pattern;
}

maps::Scan scan_from(const test::SyntheticWorld& world, const Eigen::Isometry3d& T_world_lidar,
                     std::int64_t stamp_ns) {
  maps::Scan scan;
  scan.stamp_ns = stamp_ns;
  scan.source = "scan at " + std::to_string(stamp_ns);
  scan.cloud = world.scan(T_world_lidar, pattern());
  return scan;
}

/// A sweep during which the sensor moves by a constant twist, at `T_world_lidar` in the middle.
maps::Scan rolling_from(const test::SyntheticWorld& world, const Eigen::Isometry3d& T_world_lidar,
                        const Vector6& twist, std::int64_t stamp_ns) {
  const test::ScanPattern p = pattern();
  maps::Scan scan;
  scan.stamp_ns = stamp_ns;
  for (int ring = 0; ring < p.rings; ++ring) {
    const double elevation = p.lowest_rad + ring * (p.highest_rad - p.lowest_rad) / (p.rings - 1.0);
    for (int column = 0; column < p.columns; ++column) {
      const double share = static_cast<double>(column) / p.columns;
      const double azimuth = 2.0 * std::numbers::pi * share;
      const double time_s = 0.1 * (share - 0.5);
      const Eigen::Isometry3d T = T_world_lidar * maps::exp_se3(twist * time_s);
      const Eigen::Vector3d ray(std::cos(elevation) * std::cos(azimuth),
                                std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
      const double range = world.cast(T.translation(), T.linear() * ray);
      if (!(range < p.max_range_m)) continue;
      scan.cloud.positions.push_back((range * ray).cast<float>());
      scan.cloud.time_offsets_s.push_back(static_cast<float>(time_s));
    }
  }
  return scan;
}

OdometryPose added(Odometry& odometry, const maps::Scan& scan) {
  return odometry.add(*odometry.prepare(scan));
}

/// Along a bend, `step` metres a scan.
Eigen::Isometry3d on_path(int k, double step_m = 0.3) {
  Eigen::Isometry3d T = test::pose_at(-5.0, -1.0, 0.2);
  Vector6 motion;
  motion << step_m, 0.0, 0.0, 0.0, 0.0, 0.02;
  for (int i = 0; i < k; ++i) T = T * maps::exp_se3(motion);
  return T;
}

TEST(LoamOdometry, FindsAMotionInARoomToMillimetres) {
  const test::SyntheticWorld room = test::room();
  const auto odometry = make_odometry("loam");
  for (int k = 0; k < 8; ++k) {
    const OdometryPose pose = added(*odometry, scan_from(room, on_path(k), k * kPeriodNs));
    EXPECT_THAT(pose.T_odom_lidar, IsNearPose(on_path(0).inverse() * on_path(k), 0.008, 2e-3)) << k;
    EXPECT_EQ(pose.status, k == 0 ? OdometryStatus::kPredicted : OdometryStatus::kMatched);
    if (k > 0) {
      EXPECT_GT(pose.inlier_ratio, 0.7);
    }
  }
}

TEST(LoamOdometry, StraightensSweepsFromTheFirstOneOn) {
  const test::SyntheticWorld room = test::room();
  Vector6 twist;
  twist << 6.0, 0.0, 0.0, 0.0, 0.0, 0.5;
  const Eigen::Isometry3d T_start = test::pose_at(-8.0, -2.0, 0.1);
  const auto odometry = make_odometry("loam");
  for (int k = 0; k < 6; ++k) {
    const Eigen::Isometry3d T_moved = maps::exp_se3(twist * (0.1 * k));
    const OdometryPose pose =
        added(*odometry, rolling_from(room, T_start * T_moved, twist, k * kPeriodNs));
    EXPECT_THAT(pose.T_odom_lidar, IsNearPose(T_moved, 0.03, 2e-3)) << k;
    if (k > 0) {
      EXPECT_THAT(pose.twist_lidar, test::IsNearVector(twist, 0.3)) << k;
    }
  }
}

TEST(LoamOdometry, FollowsASensorThatHangsUpsideDown) {
  test::SyntheticWorld room = test::room();
  room.boxes.push_back({{-15.5, -10.5, 5.0}, {15.5, 10.5, 5.5}});
  Eigen::Isometry3d T_flip = Eigen::Isometry3d::Identity();
  T_flip.linear() = Eigen::AngleAxisd(std::numbers::pi, Eigen::Vector3d::UnitX()).matrix();
  const auto odometry = make_odometry("loam");
  for (int k = 0; k < 4; ++k) {
    const auto pose = added(*odometry, scan_from(room, on_path(k) * T_flip, k * kPeriodNs));
    EXPECT_THAT(pose.T_odom_lidar,
                IsNearPose((on_path(0) * T_flip).inverse() * on_path(k) * T_flip, 0.015, 2e-3));
  }
}

TEST(LoamOdometry, StaysWhereTheVehicleStands) {
  const test::SyntheticWorld room = test::room();
  const auto odometry = make_odometry("loam");
  for (int k = 0; k < 5; ++k) {
    const auto pose = added(*odometry, scan_from(room, on_path(0), k * kPeriodNs));
    EXPECT_THAT(pose.T_odom_lidar, IsNearPose(Eigen::Isometry3d::Identity(), 0.008, 5e-4));
  }
}

TEST(LoamOdometry, GoesOnOverEmptyAndMissingScansAndJumpsOfTheClock) {
  const test::SyntheticWorld room = test::room();
  const auto odometry = make_odometry("loam");
  const auto expect_at = [&](int k, std::int64_t stamp_ns) {
    const auto pose = added(*odometry, scan_from(room, on_path(k), stamp_ns));
    EXPECT_THAT(pose.T_odom_lidar, IsNearPose(on_path(0).inverse() * on_path(k), 0.015, 2e-3)) << k;
    EXPECT_EQ(pose.status, k == 0 ? OdometryStatus::kPredicted : OdometryStatus::kMatched) << k;
  };
  for (int k = 0; k < 4; ++k) expect_at(k, k * kPeriodNs);
  maps::Scan empty;
  empty.stamp_ns = 4 * kPeriodNs;
  const OdometryPose predicted = added(*odometry, empty);
  EXPECT_EQ(predicted.status, OdometryStatus::kPredicted);
  EXPECT_THAT(predicted.T_odom_lidar, IsNearPose(on_path(0).inverse() * on_path(4), 0.02, 2e-3));
  EXPECT_GT(predicted.covariance(0, 0), 1e-3);
  expect_at(5, 5 * kPeriodNs);
  expect_at(8, 8 * kPeriodNs);
  expect_at(9, 9 * kPeriodNs + 3'600'000'000'000);
  expect_at(10, 10 * kPeriodNs + 3'600'000'000'000);
  // Two scans arrive at once.
  expect_at(11, 10 * kPeriodNs + 3'600'001'000'000);
  expect_at(12, 12 * kPeriodNs + 3'600'000'000'000);
}

TEST(LoamOdometry, GoesOnOverACoveredSensor) {
  const test::SyntheticWorld room = test::room();
  const auto odometry = make_odometry("loam");
  for (int k = 0; k < 7; ++k) {
    maps::Scan scan = scan_from(room, on_path(k), k * kPeriodNs);
    if (k == 4) {
      for (Eigen::Vector3f& p : scan.cloud.positions) p *= 2.0F / p.norm();
    }
    const OdometryPose pose = added(*odometry, scan);
    EXPECT_EQ(pose.hidden, k == 4) << k;
    EXPECT_THAT(pose.T_odom_lidar, IsNearPose(on_path(0).inverse() * on_path(k), 0.02, 2e-3)) << k;
  }
}

TEST(LoamOdometry, StartsWithEmptyScans) {
  const test::SyntheticWorld room = test::room();
  const auto odometry = make_odometry("loam");
  for (int k = 0; k < 2; ++k) {
    maps::Scan empty;
    empty.stamp_ns = k * kPeriodNs;
    EXPECT_TRUE(added(*odometry, empty).T_odom_lidar.isApprox(Eigen::Isometry3d::Identity()));
  }
  for (int k = 2; k < 5; ++k) {
    const auto pose = added(*odometry, scan_from(room, on_path(k), k * kPeriodNs));
    EXPECT_THAT(pose.T_odom_lidar, IsNearPose(on_path(2).inverse() * on_path(k), 0.015, 2e-3));
  }
}

TEST(LoamOdometry, InventsNoMotionAlongASmoothCorridor) {
  const test::SyntheticWorld corridor = test::corridor();
  const auto odometry = make_odometry("loam");
  for (int k = 0; k < 4; ++k) {
    const Eigen::Isometry3d T = test::pose_at(0.5 * k, 0.1 * k);
    const OdometryPose pose = added(*odometry, scan_from(corridor, T, k * kPeriodNs));
    if (k == 0) continue;
    EXPECT_EQ(pose.status, OdometryStatus::kPartly);
    ASSERT_EQ(pose.degenerate_directions.size(), 1U);
    EXPECT_GT(std::abs(pose.degenerate_directions[0][0]), 0.95);
    EXPECT_NEAR(pose.T_odom_lidar.translation().x(), 0.0, 0.02);
    EXPECT_NEAR(pose.T_odom_lidar.translation().y(), 0.1 * k, 0.01);
    EXPECT_GT(pose.covariance(0, 0), 10.0 * pose.covariance(1, 1));
  }
}

TEST(LoamOdometry, FollowsATurnThatNothingForetold) {
  const test::SyntheticWorld room = test::room();
  const auto odometry = make_odometry("loam");
  double yaw_rad = 0.2;
  for (int k = 0; k < 6; ++k) {
    if (k == 4) yaw_rad += 0.6;
    const Eigen::Isometry3d T = test::pose_at(-5.0 + 0.1 * k, -1.0, yaw_rad);
    const auto pose = added(*odometry, scan_from(room, T, k * kPeriodNs));
    EXPECT_THAT(pose.T_odom_lidar,
                IsNearPose(test::pose_at(-5.0, -1.0, 0.2).inverse() * T, 0.02, 3e-3))
        << k;
  }
}

TEST(LoamOdometry, SaysWhichStampDoesNotIncrease) {
  const test::SyntheticWorld room = test::room();
  const auto odometry = make_odometry("loam");
  added(*odometry, scan_from(room, on_path(0), 1000));
  EXPECT_THAT([&] { added(*odometry, scan_from(room, on_path(1), 1000)); },
              test::ThrowsSaying<std::invalid_argument>({"scan at 1000", "found stamp 1000 ns"}));
}

TEST(LoamOdometry, RefusesASensorWithoutRingsByName) {
  maps::Scan scan;
  scan.source = "walk/000001.pcd";
  test::Random random(5);
  for (int i = 0; i < 3000; ++i) {
    const Eigen::Vector3d ray(1.0, random.uniform(-0.6, 0.6), random.uniform(-0.6, 0.6));
    scan.cloud.positions.push_back((8.0 * ray).cast<float>());
  }
  EXPECT_THAT([&] { static_cast<void>(make_odometry("loam")->prepare(scan)); },
              test::ThrowsSaying<maps::InputError>({"walk/000001.pcd", "3000 points", "spins"}));
}

}  // namespace loam_odometry_test
}  // namespace stillmap::mapping
