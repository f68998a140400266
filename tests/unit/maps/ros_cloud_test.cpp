#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/ros_cloud.hpp>

#include "scan_bytes.hpp"
#include "support/message_bytes.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace ros_cloud_test {

using ::testing::ElementsAre;
using Kind = test::MessageBytes::Kind;

std::string cloud_of_one(Kind kind) {
  test::CloudMessage cloud;
  cloud.stamp_ns = 1'700'000'000'123'456'789;
  cloud.frame = "/front";
  test::append(cloud.data, std::array<float, 3>{1, 2, 3});
  return cloud.str(kind);
}

TEST(RosCloud, IsReadAsEitherRosSendsIt) {
  for (const auto& [type, ros, kind] :
       {std::tuple("sensor_msgs/PointCloud2", RosVersion::kRos1, Kind::kRos1),
        std::tuple("sensor_msgs/msg/PointCloud2", RosVersion::kRos2, Kind::kLittleEndian)}) {
    const std::string bytes = cloud_of_one(kind);
    const RosCloud cloud = decode_ros_cloud(type, ros, test::as_bytes(bytes), "/points");
    EXPECT_EQ(cloud.stamp_ns, 1'700'000'000'123'456'789);
    EXPECT_EQ(cloud.frame_id, "front");
    EXPECT_THAT(cloud.scan.cloud.positions, ElementsAre(Eigen::Vector3f(1, 2, 3)));
  }
}

TEST(RosCloud, RefusesOtherTypesAndWhatIsCutByTheNameOfTheTopic) {
  const std::string bytes = cloud_of_one(Kind::kRos1);
  const auto decode = [](const char* type, const std::string& message) {
    return decode_ros_cloud(type, RosVersion::kRos1, test::as_bytes(message), "/points");
  };
  EXPECT_THAT([&] { (void)decode("sensor_msgs/Image", bytes); },
              (test::ThrowsSaying<InputError>({"/points", "sensor_msgs/Image", "PointCloud2"})));
  EXPECT_THAT([&] { (void)decode("sensor_msgs/PointCloud2", bytes.substr(0, 30)); },
              (test::ThrowsSaying<InputError>({"/points"})));
}

}  // namespace ros_cloud_test
}  // namespace stillmap::maps
