#include <stillmap/localization/movable.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <support/synthetic_world.hpp>
#include <support/throws.hpp>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <string>
#include <vector>

namespace stillmap::localization {
namespace movable_test {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

maps::Box box_at(double x, double y, double yaw_rad = 0.0) {
  maps::Box box;
  box.centre = {x, y, 0.5};
  box.size_m = {4.0, 2.0, 1.5};
  box.yaw_rad = yaw_rad;
  return box;
}

std::vector<maps::Box> random_boxes(std::size_t count, std::uint64_t seed) {
  test::Random random(seed);
  std::vector<maps::Box> boxes(count);
  for (maps::Box& box : boxes) {
    for (double& c : box.centre) c = random.uniform(-50.0, 50.0);
    for (double& edge : box.size_m) edge = random.uniform(0.5, 30.0);
    box.yaw_rad = random.uniform(-7.0, 7.0);
  }
  return boxes;
}

maps::PointCloud random_points(std::size_t count, std::uint64_t seed) {
  test::Random random(seed);
  maps::PointCloud cloud;
  for (std::size_t i = 0; i < count; ++i) {
    cloud.positions.push_back(60.0F *
                              Eigen::Vector3f(static_cast<float>(random.uniform(-1.0, 1.0)),
                                              static_cast<float>(random.uniform(-1.0, 1.0)),
                                              static_cast<float>(random.uniform(-1.0, 1.0))));
  }
  return cloud;
}

TEST(Movable, LeavesOutExactlyWhatTheBoxesContain) {
  const maps::PointCloud cloud = random_points(5000, 1);
  for (const double margin_m : {0.0, 0.3}) {
    const std::vector<maps::Box> boxes = random_boxes(12, 2);
    std::vector<Eigen::Vector3f> expected;
    for (const Eigen::Vector3f& p : cloud.positions) {
      const bool inside = std::any_of(boxes.begin(), boxes.end(), [&](const maps::Box& box) {
        return box.contains(p.cast<double>(), margin_m);
      });
      if (!inside) expected.push_back(p);
    }
    EXPECT_LT(expected.size(), 4900U);
    EXPECT_EQ(without_points_in(cloud, boxes, margin_m).positions, expected);
  }
}

TEST(Movable, TurnsLengthCounterClockwise) {
  maps::PointCloud cloud;
  cloud.positions = {{11.9F, 0.0F, 0.5F}, {10.0F, 1.9F, 0.5F}, {10.0F, -1.9F, 0.5F}};
  const std::vector<maps::Box> along = {box_at(10.0, 0.0)};
  EXPECT_THAT(without_points_in(cloud, along, 0.0).positions,
              ElementsAre(cloud.positions[1], cloud.positions[2]));
  const std::vector<maps::Box> across = {box_at(10.0, 0.0, std::numbers::pi / 2.0)};
  EXPECT_THAT(without_points_in(cloud, across, 0.0).positions, ElementsAre(cloud.positions[0]));
}

TEST(Movable, AttributesGoWithTheirPoints) {
  maps::PointCloud cloud;
  cloud.positions = {{1.0F, 0.0F, 0.5F}, {10.0F, 0.0F, 0.5F}, {20.0F, 0.0F, 0.5F}};
  cloud.intensities = {0.1F, 0.2F, 0.3F};
  cloud.time_offsets_s = {-0.1F, -0.05F, 0.0F};
  const std::vector<maps::Box> boxes = {box_at(10.0, 0.0)};
  const maps::PointCloud kept = without_points_in(cloud, boxes);
  EXPECT_THAT(kept.intensities, ElementsAre(0.1F, 0.3F));
  EXPECT_THAT(kept.time_offsets_s, ElementsAre(-0.1F, 0.0F));
}

TEST(Movable, NoBoxAndNoPointAreNothingToDo) {
  const maps::PointCloud cloud = random_points(100, 3);
  EXPECT_EQ(without_points_in(cloud, {}).positions, cloud.positions);
  EXPECT_THAT(without_points_in({}, random_boxes(3, 4)).positions, IsEmpty());
}

TEST(Movable, PointsFarBeyondAllBoxesStay) {
  maps::PointCloud cloud;
  const float infinity = std::numeric_limits<float>::infinity();
  cloud.positions = {{1e30F, 0.0F, 0.0F},
                     {0.0F, -1e30F, 0.0F},
                     {infinity, 0.0F, 0.0F},
                     {0.0F, std::numeric_limits<float>::quiet_NaN(), 0.0F}};
  maps::Box box = box_at(0.0, 0.0);
  box.size_m.setConstant(kMaxBoxEdgeM);
  EXPECT_EQ(without_points_in(cloud, std::vector{box}).size(), 4U);
}

TEST(Movable, BrokenBoxesAreNamed) {
  const maps::PointCloud cloud = random_points(10, 5);
  const auto refused = [&](const maps::Box& box, const std::vector<std::string>& texts) {
    const std::vector<maps::Box> boxes = {box_at(0.0, 0.0), box};
    EXPECT_THAT([&] { (void)without_points_in(cloud, boxes); },
                test::ThrowsSaying<std::invalid_argument>(texts));
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const double bad : {nan, std::numeric_limits<double>::infinity(), 2e5, -2e5}) {
    maps::Box box = box_at(0.0, 0.0);
    box.centre.z() = bad;
    refused(box, {"box 1: found centre", "within 100000 m"});
  }
  for (const double bad : {nan, 0.0, -1.0, 101.0}) {
    maps::Box box = box_at(0.0, 0.0);
    box.size_m.y() = bad;
    refused(box, {"box 1: found size", "up to 100 m"});
  }
  refused(box_at(0.0, 0.0, nan), {"box 1: found yaw nan"});
  for (const double bad : {nan, -0.1, 10.1}) {
    EXPECT_THROW((void)without_points_in(cloud, {}, bad), std::invalid_argument) << bad;
  }
}

}  // namespace movable_test
}  // namespace stillmap::localization
