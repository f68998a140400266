#include "detection/box_fit.hpp"

#include <gtest/gtest.h>
#include <Eigen/Geometry>

#include <cmath>
#include <limits>
#include <numbers>

namespace stillmap::mapping {
namespace box_fit_test {

using maps::Box;
using maps::ObjectClass;
using maps::PointCloud;

constexpr double kDeg = std::numbers::pi / 180.0;

Box car_at(double x, double y, double yaw_deg) {
  Box box;
  box.centre = {x, y, -0.9};
  box.size_m = {4.4, 1.8, 1.5};
  box.yaw_rad = yaw_deg * kDeg;
  box.object_class = ObjectClass::kCar;
  box.score = 0.9;
  return box;
}

Eigen::Vector3d in_frame(const Box& box, double along, double across, double up) {
  return box.centre + Eigen::AngleAxisd(box.yaw_rad, Eigen::Vector3d::UnitZ()) *
                          Eigen::Vector3d(along, across, up);
}

/// Points on the sides of a box that face the sensor at the origin, `steps` along each.
void add_seen_sides(PointCloud& cloud, const Box& box, int steps) {
  const Eigen::Vector3d half = 0.5 * box.size_m;
  const Eigen::Vector3d sensor =
      Eigen::AngleAxisd(-box.yaw_rad, Eigen::Vector3d::UnitZ()) * -box.centre;
  const double end = std::copysign(half.x(), sensor.x());
  const double side = std::copysign(half.y(), sensor.y());
  for (int i = 0; i <= steps; ++i) {
    const double share = 2.0 * i / steps - 1.0;
    if (std::abs(sensor.x()) > half.x())
      cloud.positions.push_back(in_frame(box, end, share * half.y(), 0.0).cast<float>());
    if (std::abs(sensor.y()) > half.y())
      cloud.positions.push_back(in_frame(box, share * half.x(), side, 0.1).cast<float>());
  }
}

double turn_deg(double a_rad, double b_rad) {
  return std::abs(std::remainder(a_rad - b_rad, std::numbers::pi)) / kDeg;
}

double off_m(const Box& a, const Box& b) { return (a.centre - b.centre).head<2>().norm(); }

TEST(BoxFit, MovesABoxToTheSidesThatAreSeen) {
  const Box truth = car_at(14.0, 9.0, 20.0);
  PointCloud cloud;
  add_seen_sides(cloud, truth, 20);
  std::vector<Box> boxes{truth};
  boxes[0].centre += Eigen::Vector3d(0.25, -0.2, 0.0);
  fit_to_points(boxes, cloud);
  EXPECT_LT(off_m(boxes[0], truth), 0.1);
  EXPECT_LT(turn_deg(boxes[0].yaw_rad, truth.yaw_rad), 1e-6);
  for (const Eigen::Vector3f& p : cloud.positions)
    EXPECT_TRUE(boxes[0].contains(p.cast<double>(), 1e-4));
}

TEST(BoxFit, TakesTheHeadingOfNeighboursThatThePointsAgreeWith) {
  const Box truth = car_at(18.0, 12.0, 35.0);
  PointCloud cloud;
  add_seen_sides(cloud, truth, 12);
  std::vector<Box> boxes{truth, car_at(22.0, 6.0, 35.0)};
  boxes[0].yaw_rad -= 30.0 * kDeg;
  boxes[0].centre.x() += 0.3;
  fit_to_points(boxes, cloud);
  EXPECT_LT(turn_deg(boxes[0].yaw_rad, truth.yaw_rad), 1e-6);
  EXPECT_LT(off_m(boxes[0], truth), 0.3);
  EXPECT_EQ(boxes[1].yaw_rad, 35.0 * kDeg);  // no points of its own
}

TEST(BoxFit, NeighboursTurnNoBoxAgainstItsPoints) {
  const Box truth = car_at(12.0, 8.0, 30.0);
  PointCloud cloud;
  add_seen_sides(cloud, truth, 40);
  std::vector<Box> boxes{truth, car_at(17.0, 2.0, 75.0)};
  fit_to_points(boxes, cloud);
  EXPECT_LT(turn_deg(boxes[0].yaw_rad, truth.yaw_rad), 1e-6);
}

TEST(BoxFit, KeepsTheEndThatWasSaidToBeTheFront) {
  const Box truth = car_at(18.0, 12.0, 35.0);
  PointCloud cloud;
  add_seen_sides(cloud, truth, 6);
  std::vector<Box> boxes{truth, car_at(22.0, 6.0, 35.0)};
  boxes[0].yaw_rad = (35.0 + 180.0 - 20.0) * kDeg;
  fit_to_points(boxes, cloud);
  EXPECT_NEAR(std::remainder(boxes[0].yaw_rad - 215.0 * kDeg, 2.0 * std::numbers::pi), 0.0, 1e-6);
}

TEST(BoxFit, ReachesAroundPointsALittleOutsideAndNoFarther) {
  const Box truth = car_at(15.0, 0.0, 0.0);
  PointCloud cloud;
  add_seen_sides(cloud, truth, 20);
  for (const double across : {-0.9, 0.9})
    cloud.positions.push_back(in_frame(truth, 0.5, across, 0.0).cast<float>());
  const Eigen::Vector3d rack = in_frame(truth, 0.0, 0.0, 0.9);
  const Eigen::Vector3d branch = in_frame(truth, 0.0, 0.5, 1.0);
  for (const Eigen::Vector3d& p : {rack, branch}) cloud.positions.push_back(p.cast<float>());
  std::vector<Box> boxes{truth};
  fit_to_points(boxes, cloud);
  EXPECT_TRUE(boxes[0].contains(rack, 1e-4));
  EXPECT_FALSE(boxes[0].contains(branch));
  EXPECT_NEAR(boxes[0].centre.z() - 0.5 * boxes[0].size_m.z(),
              truth.centre.z() - 0.5 * truth.size_m.z(), 1e-9);
}

TEST(BoxFit, LeavesWhatItKnowsNothingOf) {
  Box pedestrian = car_at(8.0, 3.0, 10.0);
  pedestrian.object_class = ObjectClass::kPedestrian;
  PointCloud cloud;
  add_seen_sides(cloud, car_at(8.3, 3.0, 10.0), 20);
  const Box alone = car_at(-20.0, 5.0, 80.0);
  cloud.positions.emplace_back(-20.0F, 5.3F, -0.9F);
  cloud.positions.emplace_back(std::numeric_limits<float>::quiet_NaN(), 0.0F, 0.0F);
  std::vector<Box> boxes{pedestrian, alone};
  fit_to_points(boxes, cloud);
  EXPECT_EQ(boxes[0].centre, pedestrian.centre);
  EXPECT_EQ(boxes[1].centre, alone.centre);
  EXPECT_EQ(boxes[1].size_m, alone.size_m);
  std::vector<Box> none;
  fit_to_points(none, cloud);
  EXPECT_TRUE(none.empty());
  fit_to_points(boxes, {});
  EXPECT_EQ(boxes[1].centre, alone.centre);
}

TEST(BoxFit, FollowsATurnOfTheScan) {
  const Box truth = car_at(14.0, 9.0, 20.0);
  std::vector<Box> first{truth, car_at(10.0, -9.0, 24.0)}, second;
  first[0].centre.x() += 0.3;
  const Eigen::AngleAxisd turn(70.0 * kDeg, Eigen::Vector3d::UnitZ());
  PointCloud cloud, turned;
  add_seen_sides(cloud, truth, 20);
  for (const Eigen::Vector3f& p : cloud.positions)
    turned.positions.push_back((turn * p.cast<double>()).cast<float>());
  for (Box box : first) {
    box.centre = turn * box.centre;
    box.yaw_rad += 70.0 * kDeg;
    second.push_back(box);
  }
  fit_to_points(first, cloud);
  fit_to_points(second, turned);
  EXPECT_LT((turn * first[0].centre - second[0].centre).norm(), 1e-4);
  EXPECT_LT((first[0].size_m - second[0].size_m).norm(), 1e-4);
  EXPECT_LT(turn_deg(first[0].yaw_rad + 70.0 * kDeg, second[0].yaw_rad), 1e-6);
}

}  // namespace box_fit_test
}  // namespace stillmap::mapping
