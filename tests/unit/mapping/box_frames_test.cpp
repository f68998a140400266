#include "fusion/box_frames.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "support/matchers.hpp"
#include "support/synthetic_world.hpp"

namespace stillmap::mapping {
namespace box_frames_test {

using test::IsNearVector;

maps::Box box_at(double x, double y, double length_m, double width_m, double yaw_rad = 0.0) {
  maps::Box box;
  box.centre = {x, y, 0.5};
  box.size_m = {length_m, width_m, 1.0};
  box.yaw_rad = yaw_rad;
  return box;
}

TEST(BoxFrames, GoToTheMapAndBack) {
  const Eigen::Isometry3d T_map_lidar = test::pose_at(100.0, -20.0, 2.5, 1.7);
  const maps::Box box = box_at(5.0, -3.0, 4.0, 2.0, -1.2);
  const maps::Box there = to_map(box, T_map_lidar);
  EXPECT_THAT(there.centre, IsNearVector(T_map_lidar * box.centre, 1e-12));
  EXPECT_NEAR(std::remainder(there.yaw_rad - 1.3, 2.0 * std::numbers::pi), 0.0, 1e-12);
  const maps::Box back = to_lidar(there, T_map_lidar);
  EXPECT_THAT(back.centre, IsNearVector(box.centre, 1e-12));
  EXPECT_NEAR(back.yaw_rad, -1.2, 1e-12);
  EXPECT_EQ(back.size_m, box.size_m);
}

TEST(BoxFrames, ATiltedSensorKeepsTheHeading) {
  Eigen::Isometry3d T_map_lidar = test::pose_at(0.0, 0.0, 0.7);
  T_map_lidar.rotate(Eigen::AngleAxisd(0.1, Eigen::Vector3d(0.6, 0.8, 0.0)));
  const maps::Box box = box_at(5.0, -3.0, 4.0, 2.0, 0.4);
  EXPECT_NEAR(to_lidar(to_map(box, T_map_lidar), T_map_lidar).yaw_rad, 0.4, 0.5 * 0.1 * 0.1);
}

TEST(BoxFrames, ShareWhatTheyShare) {
  const maps::Box box = box_at(0.0, 0.0, 4.0, 2.0);
  EXPECT_NEAR(shared_area_m2(box, box), 8.0, 1e-12);
  EXPECT_NEAR(shared_area_m2(box, box_at(1.0, 0.5, 4.0, 2.0)), 3.0 * 1.5, 1e-12);
  EXPECT_NEAR(shared_area_m2(box, box_at(0.0, 0.0, 2.0, 4.0)), 4.0, 1e-12);
  EXPECT_NEAR(shared_area_m2(box, box_at(0.0, 0.0, 4.0, 2.0, 0.5 * std::numbers::pi)), 4.0, 1e-9);
  // A square turned by 45 degrees over a large one, and over itself: the regular octagon.
  EXPECT_NEAR(
      shared_area_m2(box_at(0, 0, 10.0, 10.0), box_at(1, 1, 2.0, 2.0, 0.25 * std::numbers::pi)),
      4.0, 1e-9);
  EXPECT_NEAR(
      shared_area_m2(box_at(0, 0, 2.0, 2.0), box_at(0, 0, 2.0, 2.0, 0.25 * std::numbers::pi)),
      8.0 * (std::numbers::sqrt2 - 1.0), 1e-9);
  EXPECT_EQ(shared_area_m2(box, box_at(4.1, 0.0, 4.0, 2.0)), 0.0);
  EXPECT_EQ(shared_area_m2(box, box_at(50.0, 0.0, 4.0, 2.0)), 0.0);
}

TEST(BoxFrames, OverlapIsOfBothAndOfTheSmaller) {
  const BoxOverlap overlap = overlap_of(box_at(0.0, 0.0, 4.0, 2.0), box_at(1.0, 0.0, 2.0, 2.0));
  EXPECT_NEAR(overlap.of_joint, 0.5, 1e-12);
  EXPECT_NEAR(overlap.of_smaller, 1.0, 1e-12);
}

}  // namespace box_frames_test
}  // namespace stillmap::mapping
