#include <stillmap/maps/box.hpp>

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

namespace stillmap::maps {
namespace box_test {

Box turned_car() {
  Box box;
  box.centre = {10.0, 5.0, -1.0};
  box.size_m = {4.0, 2.0, 1.5};
  box.yaw_rad = std::numbers::pi / 2.0;
  return box;
}

TEST(Box, LengthLiesAlongTheHeading) {
  const Box box = turned_car();
  EXPECT_TRUE(box.contains({10.0, 6.9, -1.0}));
  EXPECT_FALSE(box.contains({11.9, 5.0, -1.0}));
}

TEST(Box, YawTurnsCounterClockwise) {
  Box box = turned_car();
  box.yaw_rad = std::numbers::pi / 4.0;
  const double d = 1.9 / std::numbers::sqrt2;
  EXPECT_TRUE(box.contains(box.centre + Eigen::Vector3d(d, d, 0.0)));
  EXPECT_FALSE(box.contains(box.centre + Eigen::Vector3d(d, -d, 0.0)));
}

TEST(Box, MarginGrowsEverySide) {
  const Box box = turned_car();
  for (const Eigen::Vector3d& face :
       {Eigen::Vector3d(1.0, 0.0, 0.0), Eigen::Vector3d(-1.0, 0.0, 0.0),
        Eigen::Vector3d(0.0, 2.0, 0.0), Eigen::Vector3d(0.0, -2.0, 0.0),
        Eigen::Vector3d(0.0, 0.0, 0.75), Eigen::Vector3d(0.0, 0.0, -0.75)}) {
    const Eigen::Vector3d outside = box.centre + face + 0.1 * face.normalized();
    EXPECT_FALSE(box.contains(outside)) << face.transpose();
    EXPECT_TRUE(box.contains(outside, 0.11)) << face.transpose();
    EXPECT_FALSE(box.contains(outside, 0.09)) << face.transpose();
  }
}

TEST(Box, NanIsOutside) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  Box box = turned_car();
  EXPECT_FALSE(box.contains({nan, 5.0, -1.0}));
  EXPECT_FALSE(box.contains({10.0, 5.0, nan}));
  box.yaw_rad = nan;
  EXPECT_FALSE(box.contains(box.centre));
}

TEST(ObjectClass, NamesReadBack) {
  for (int i = 0; i <= static_cast<int>(ObjectClass::kUnknown); ++i) {
    const auto object_class = static_cast<ObjectClass>(i);
    EXPECT_EQ(object_class_from(name_of(object_class)), object_class);
  }
  EXPECT_EQ(object_class_from("Car"), std::nullopt);
}

}  // namespace box_test
}  // namespace stillmap::maps
