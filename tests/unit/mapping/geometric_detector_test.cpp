#include "detection/geometric_detector.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/mapping/ground.hpp>

#include <cmath>
#include <numbers>

#include "support/matchers.hpp"
#include "support/synthetic_world.hpp"

namespace stillmap::mapping {
namespace geometric_detector_test {

using test::IsNearVector;
using ::testing::IsEmpty;
using ::testing::SizeIs;

const test::SyntheticWorld::Box kCar{{8.0, 3.0, 0.0}, {12.3, 4.8, 1.5}};

std::vector<maps::Box> detect(const test::SyntheticWorld& world, double yaw_rad = 0.0) {
  test::ScanPattern pattern;
  pattern.rings = 64;
  pattern.columns = 1440;
  pattern.noise_m = 0.01;
  maps::Scan scan;
  scan.cloud = world.scan(test::pose_at(0.0, 0.0, yaw_rad), pattern);
  return GeometricDetector().detect(scan, make_ground_segmenter()->segment(scan.cloud));
}

test::SyntheticWorld world_of(std::vector<test::SyntheticWorld::Box> boxes) {
  test::SyntheticWorld world;
  world.boxes = std::move(boxes);
  return world;
}

/// Angle between two undirected headings.
double heading_error_rad(double a, double b) {
  return std::abs(std::remainder(a - b, std::numbers::pi));
}

TEST(GeometricDetector, FindsACarByItsTwoVisibleSides) {
  const auto boxes = detect(world_of({kCar}));
  ASSERT_THAT(boxes, SizeIs(1));
  const maps::Box& car = boxes[0];
  EXPECT_EQ(car.object_class, maps::ObjectClass::kCar);
  EXPECT_THAT(car.centre.head<2>(), IsNearVector(Eigen::Vector2d(10.15, 3.9), 0.15));
  EXPECT_THAT(car.size_m.head<2>(), IsNearVector(Eigen::Vector2d(4.3, 1.8), 0.25));
  EXPECT_LT(heading_error_rad(car.yaw_rad, 0.0), 0.04);
  // From below the ground under it to above its roof.
  EXPECT_LT(car.centre.z() - 0.5 * car.size_m.z(), -1.8);
  EXPECT_GT(car.centre.z() + 0.5 * car.size_m.z(), -0.35);
  EXPECT_GT(car.score, 0.5);
  EXPECT_LE(car.score, 1.0);
}

TEST(GeometricDetector, TurnsWithTheSensor) {
  for (const double yaw_rad : {0.4, 1.9, -2.6}) {
    const auto boxes = detect(world_of({kCar}), yaw_rad);
    ASSERT_THAT(boxes, SizeIs(1)) << yaw_rad;
    const Eigen::Vector3d centre_world =
        Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()) * boxes[0].centre;
    EXPECT_THAT(centre_world.head<2>(), IsNearVector(Eigen::Vector2d(10.15, 3.9), 0.3));
    EXPECT_LT(heading_error_rad(boxes[0].yaw_rad + yaw_rad, 0.0), 0.05) << yaw_rad;
  }
}

TEST(GeometricDetector, CompletesACarOfWhichOnlyTheRearIsSeen) {
  // With a bumper: a face without any depth may as well be a board.
  const auto boxes = detect(
      world_of({{{8.15, -0.9, 0.2}, {12.3, 0.9, 1.5}}, {{8.0, -0.8, 0.2}, {8.2, 0.8, 0.5}}}));
  ASSERT_THAT(boxes, SizeIs(1));
  EXPECT_THAT(boxes[0].centre.head<2>(), IsNearVector(Eigen::Vector2d(10.15, 0.0), 0.3));
  EXPECT_THAT(boxes[0].size_m.head<2>(), IsNearVector(Eigen::Vector2d(4.3, 1.8), 0.3));
  EXPECT_LT(heading_error_rad(boxes[0].yaw_rad, 0.0), 0.04);
}

TEST(GeometricDetector, FindsACarInFrontOfAWall) {
  const auto boxes = detect(world_of({kCar, {{-20.0, 5.6, 0.0}, {30.0, 6.0, 5.0}}}));
  ASSERT_THAT(boxes, SizeIs(1));
  EXPECT_THAT(boxes[0].centre.head<2>(), IsNearVector(Eigen::Vector2d(10.15, 3.9), 0.3));
}

TEST(GeometricDetector, FindsATruckAsVan) {
  const auto boxes = detect(world_of({{{8.0, 3.0, 0.0}, {14.0, 5.4, 3.2}}}));
  ASSERT_THAT(boxes, SizeIs(1));
  EXPECT_EQ(boxes[0].object_class, maps::ObjectClass::kVan);
  EXPECT_THAT(boxes[0].centre.head<2>(), IsNearVector(Eigen::Vector2d(11.0, 4.2), 0.3));
}

TEST(GeometricDetector, LeavesWallsAlone) {
  EXPECT_THAT(detect(world_of({{{-10.0, 4.0, 0.0}, {10.0, 4.3, 1.5}}})), IsEmpty());
  EXPECT_THAT(detect(world_of({{{-10.0, 4.0, 0.0}, {10.0, 4.3, 5.0}}})), IsEmpty());
}

TEST(GeometricDetector, LeavesPolesAlone) {
  test::SyntheticWorld world;
  world.cylinders = {{{6.0, 2.0}, 0.1, 5.0}, {{-4.0, 5.0}, 0.08, 1.2}, {{3.0, -6.0}, 0.3, 6.0}};
  EXPECT_THAT(detect(world), IsEmpty());
}

TEST(GeometricDetector, LeavesFlatGroundAndKerbsAlone) {
  EXPECT_THAT(detect(test::field()), IsEmpty());
  EXPECT_THAT(detect(world_of({{{6.0, 3.0, 0.0}, {10.3, 4.8, 0.2}}})), IsEmpty());
}

TEST(GeometricDetector, FindsNothingInAnEmptyScan) {
  const maps::Scan scan;
  EXPECT_THAT(GeometricDetector().detect(scan, make_ground_segmenter()->segment(scan.cloud)),
              IsEmpty());
}

}  // namespace geometric_detector_test
}  // namespace stillmap::mapping
