#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/mapping/deskew.hpp>
#include <stillmap/maps/frames.hpp>

#include "support/matchers.hpp"

namespace stillmap::mapping {
namespace deskew_test {

using test::IsNearVector;
using Twist = Eigen::Matrix<double, 6, 1>;

Twist twist_of(double vx, double vy, double vz, double wx, double wy, double wz) {
  return (Twist() << vx, vy, vz, wx, wy, wz).finished();
}

/// A wall at x = 10 m, each point as a sensor sees it that moves while it sweeps.
maps::PointCloud wall_seen_while_moving(const Twist& twist) {
  maps::PointCloud cloud;
  for (int i = 0; i <= 100; ++i) {
    const double time_s = -0.05 + 0.001 * i;
    const Eigen::Vector3d p_stamp(10.0, -5.0 + 0.1 * i, 0.02 * i);
    const Eigen::Isometry3d T_stamp_now = maps::exp_se3(Twist(twist * time_s));
    cloud.positions.push_back((T_stamp_now.inverse() * p_stamp).cast<float>());
    cloud.time_offsets_s.push_back(static_cast<float>(time_s));
  }
  return cloud;
}

void expect_straight(const Twist& twist) {
  maps::PointCloud cloud = wall_seen_while_moving(twist);
  deskew(cloud, twist);
  for (int i = 0; i <= 100; ++i) {
    const Eigen::Vector3f p_stamp(10.0F, -5.0F + 0.1F * static_cast<float>(i),
                                  0.02F * static_cast<float>(i));
    ASSERT_THAT(cloud.positions[static_cast<std::size_t>(i)], IsNearVector(p_stamp, 1e-5F));
  }
}

maps::Drive drive_along(const Twist& twist, const std::vector<double>& times_s) {
  maps::Drive::Contents contents;
  for (const double time_s : times_s) {
    contents.scan_files.emplace_back("scan.bin");
    contents.stamps_ns.push_back(std::llround(time_s * 1e9));
    contents.T_map_lidar.push_back(maps::exp_se3(twist_of(5.0, -3.0, 1.0, 0.1, 0.2, 2.0)) *
                                   maps::exp_se3(Twist(twist * time_s)));
  }
  return maps::Drive(std::move(contents));
}

TEST(Deskew, StraightensAWallSeenByAMovingAndTurningSensor) {
  expect_straight(twist_of(20.0, -1.0, 0.5, 0.3, -0.2, 1.5));
}

TEST(Deskew, StraightensAWallSeenInAFastTurn) {
  // 0.15 rad and more at both ends of the sweep.
  expect_straight(twist_of(2.0, -1.0, 0.5, 0.5, -0.2, 5.0));
}

TEST(Deskew, StraightensAWallSeenWithoutTurning) { expect_straight(twist_of(20, 3, -1, 0, 0, 0)); }

TEST(Deskew, TheTestedMotionBendsTheWallByMoreThanTheTolerance) {
  const maps::PointCloud bent = wall_seen_while_moving(twist_of(20.0, -1.0, 0.5, 0.3, -0.2, 1.5));
  EXPECT_GT(std::abs(bent.positions.front().x() - 10.0F), 0.5F);
}

TEST(Deskew, LeavesAPointOfTheStampWhereItIs) {
  maps::PointCloud cloud;
  cloud.positions = {{3.0F, -2.0F, 1.0F}};
  cloud.time_offsets_s = {0.0F};
  deskew(cloud, twist_of(20.0, 1.0, 2.0, 0.1, 0.2, 3.0));
  EXPECT_EQ(cloud.positions[0], Eigen::Vector3f(3.0F, -2.0F, 1.0F));
}

TEST(Deskew, DoesNothingWithoutTimes) {
  const Twist twist = twist_of(20.0, 0.0, 0.0, 0.0, 0.0, 1.0);
  maps::PointCloud cloud = wall_seen_while_moving(twist);
  cloud.time_offsets_s.clear();
  const std::vector<Eigen::Vector3f> before = cloud.positions;
  deskew(cloud, twist);
  EXPECT_EQ(cloud.positions, before);
}

TEST(Twist, OfAConstantMotionIsFoundAtEveryScanAlsoAtTheEnds) {
  const Twist truth = twist_of(8.0, -0.5, 0.2, 0.02, -0.05, 0.4);
  const maps::Drive drive = drive_along(truth, {0.0, 0.1, 0.25, 0.3});
  for (std::size_t index = 0; index < drive.size(); ++index) {
    const auto twist = twist_at(drive, index);
    ASSERT_TRUE(twist) << index;
    EXPECT_THAT(*twist, IsNearVector(truth, 1e-6)) << index;
  }
}

TEST(Twist, IgnoresANeighbourBehindAGapInTime) {
  const maps::Drive drive = drive_along(twist_of(8.0, 0, 0, 0, 0, 0), {0.0, 0.1, 9.0});
  const auto twist = twist_at(drive, 1);
  ASSERT_TRUE(twist);
  EXPECT_THAT(*twist, IsNearVector(twist_of(8.0, 0, 0, 0, 0, 0), 1e-6));
  EXPECT_FALSE(twist_at(drive, 2));
}

TEST(Twist, IsUnknownWithoutNeighboursOrPosesOrBeyondTheDrive) {
  const Twist any = twist_of(8.0, 0, 0, 0, 0, 0);
  EXPECT_FALSE(twist_at(drive_along(any, {0.0}), 0));
  EXPECT_FALSE(twist_at(drive_along(any, {0.0, 0.1}), 2));
  maps::Drive::Contents contents = drive_along(any, {0.0, 0.1}).contents();
  contents.T_map_lidar.clear();
  EXPECT_FALSE(twist_at(maps::Drive(std::move(contents)), 0));
}

}  // namespace deskew_test
}  // namespace stillmap::mapping
