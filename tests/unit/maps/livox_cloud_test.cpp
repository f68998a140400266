#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>

#include "bags/livox_cloud.hpp"
#include "scan_bytes.hpp"
#include "support/message_bytes.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace livox_cloud_test {

using test::MessageBytes;
using test::ThrowsSaying;
using ::testing::ElementsAre;
using ::testing::FloatNear;
using ::testing::IsEmpty;
using Kind = MessageBytes::Kind;

constexpr std::int64_t kStampNs = 1'700'000'000'000'000'000;

struct Point {
  std::uint32_t offset_ns = 0;
  float x = 0.0F;
  std::uint8_t tag = 0;
};

std::string message_of(const std::vector<Point>& points, std::int64_t timebase_ns, Kind kind) {
  MessageBytes message(kind);
  message.header(kStampNs, "livox").put(static_cast<std::uint64_t>(timebase_ns));
  message.put(static_cast<std::uint32_t>(points.size()));
  for (const int value : {3, 0, 0, 0}) message.put(static_cast<std::uint8_t>(value));
  message.put(static_cast<std::uint32_t>(points.size()));
  for (const Point& point : points) {
    message.put(point.offset_ns).put(point.x).put(2.0F).put(-1.0F);
    message.put(std::uint8_t{77}).put(point.tag).put(std::uint8_t{5});
  }
  return message.str();
}

DecodedScan decode(const std::vector<Point>& points, std::int64_t timebase_ns = kStampNs,
                   Kind kind = Kind::kLittleEndian) {
  const std::string bytes = message_of(points, timebase_ns, kind);
  MessageReader reader(test::as_bytes(bytes),
                       kind == Kind::kRos1 ? Serialization::kRos1 : Serialization::kCdr, "cloud");
  return decode_livox_cloud(reader, 1000);
}

TEST(LivoxCloud, IsToldByTheTypesOfItsThreeDrivers) {
  for (const char* type : {"livox_ros_driver/CustomMsg", "livox_ros_driver2/CustomMsg",
                           "livox_ros_driver2/msg/CustomMsg", "livox_interfaces/msg/CustomMsg"})
    EXPECT_TRUE(is_livox_type(ros2_type(type))) << type;
  EXPECT_FALSE(is_livox_type(kPointCloud2));
}

TEST(LivoxCloud, ReadsPointsWithTheirTimesInEverySerialization) {
  for (const Kind kind : {Kind::kLittleEndian, Kind::kBigEndian, Kind::kRos1}) {
    const DecodedScan scan = decode({{0, 4.0F, 0}, {50'000'000, 5.0F, 0x10}}, kStampNs, kind);
    EXPECT_THAT(scan.cloud.positions,
                ElementsAre(Eigen::Vector3f(4, 2, -1), Eigen::Vector3f(5, 2, -1)));
    EXPECT_THAT(scan.cloud.intensities, ElementsAre(77.0F, 77.0F));
    EXPECT_THAT(scan.cloud.time_offsets_s, ElementsAre(0.0F, FloatNear(0.05F, 1e-7F)));
    EXPECT_EQ(scan.points_in_file, 2U);
  }
}

TEST(LivoxCloud, LeavesOutLateEchoesAndPointsOfTheLeastConfidence) {
  const DecodedScan scan =
      decode({{1, 1.0F, 0x00}, {2, 2.0F, 0x20}, {3, 3.0F, 0x31}, {4, 4.0F, 0x1f}});
  EXPECT_THAT(scan.cloud.positions,
              ElementsAre(Eigen::Vector3f(1, 2, -1), Eigen::Vector3f(4, 2, -1)));
  EXPECT_THAT(scan.cloud.file_indices, ElementsAre(0U, 3U));
  EXPECT_THAT(scan.cloud.time_offsets_s,
              ElementsAre(FloatNear(1e-9F, 1e-12F), FloatNear(4e-9F, 1e-12F)));
  EXPECT_EQ(scan.dropped.unsure, 2U);
}

TEST(LivoxCloud, CountsTimesFromTheStampAndFromTheTimebaseOfAnotherClock) {
  const auto time = [](std::int64_t timebase_ns) {
    return decode({{50'000'000, 1.0F, 0}}, timebase_ns).cloud.time_offsets_s.at(0);
  };
  EXPECT_FLOAT_EQ(time(kStampNs), 0.05F);
  EXPECT_FLOAT_EQ(time(kStampNs - 100'000'000), -0.05F);
  EXPECT_FLOAT_EQ(time(543'000'000'000), 0.05F);
  EXPECT_FLOAT_EQ(time(-1), 0.05F);
  EXPECT_THAT(decode({{4'000'000'000, 1.0F, 0}}).cloud.time_offsets_s, IsEmpty());
}

TEST(LivoxCloud, IsRefusedWhereItIsCutAtAnyByte) {
  const std::string whole = message_of({{0, 1.0F, 0}, {9, 2.0F, 0}}, kStampNs, Kind::kRos1);
  for (std::size_t size = 0; size < whole.size(); ++size) {
    const std::string cut = whole.substr(0, size);
    EXPECT_THAT(
        [&] {
          MessageReader reader(test::as_bytes(cut), Serialization::kRos1, "cut");
          (void)decode_livox_cloud(reader);
        },
        ThrowsSaying<InputError>({"cut"}))
        << size;
  }
}

}  // namespace livox_cloud_test
}  // namespace stillmap::maps
