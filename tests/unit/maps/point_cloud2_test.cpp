#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>

#include <cmath>
#include <limits>

#include "bags/point_cloud2.hpp"
#include "scan_bytes.hpp"
#include "support/message_bytes.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace point_cloud2_test {

using test::append;
using test::append_big_endian;
using test::CloudMessage;
using test::ThrowsSaying;
using ::testing::ElementsAre;
using ::testing::FloatEq;
using Kind = test::MessageBytes::Kind;

DecodedScan decode(const CloudMessage& cloud, Kind kind = Kind::kLittleEndian) {
  const std::string bytes = cloud.str(kind);
  MessageReader reader(test::as_bytes(bytes),
                       kind == Kind::kRos1 ? Serialization::kRos1 : Serialization::kCdr, "cloud");
  return decode_point_cloud2(reader, 1000);
}

/// One point with x y z of one type and whatever more.
template <typename Number>
CloudMessage cloud_of(std::uint8_t type, bool big_endian) {
  CloudMessage cloud;
  const auto size = static_cast<std::uint32_t>(sizeof(Number));
  cloud.fields = {{"z", 0, type}, {"x", size, type}, {"y", 2 * size, type}};
  cloud.big_endian = big_endian;
  cloud.point_step = 3 * size + 5;
  cloud.row_step = 2 * cloud.point_step;
  cloud.width = 2;
  for (const int first : {3, 6}) {
    for (const int value : {first, first - 2, first - 1}) {
      if (big_endian) {
        append_big_endian(cloud.data, static_cast<Number>(value));
      } else {
        append(cloud.data, static_cast<Number>(value));
      }
    }
    cloud.data.append(5, '\x7f');
  }
  return cloud;
}

template <typename Number>
void expect_type(std::uint8_t type) {
  for (const bool big_endian : {false, true}) {
    for (const Kind kind : {Kind::kLittleEndian, Kind::kBigEndian, Kind::kRos1}) {
      const DecodedScan scan = decode(cloud_of<Number>(type, big_endian), kind);
      EXPECT_THAT(scan.cloud.positions,
                  ElementsAre(Eigen::Vector3f(1, 2, 3), Eigen::Vector3f(4, 5, 6)))
          << int{type} << big_endian;
    }
  }
}

TEST(PointCloud2, ReadsEveryTypeInBothByteOrders) {
  expect_type<std::int8_t>(1);
  expect_type<std::uint8_t>(2);
  expect_type<std::int16_t>(3);
  expect_type<std::uint16_t>(4);
  expect_type<std::int32_t>(5);
  expect_type<std::uint32_t>(6);
  expect_type<float>(7);
  expect_type<double>(8);
}

TEST(PointCloud2, ReadsRowsWithPaddingAndDropsWhatIsNoPoint) {
  CloudMessage cloud;
  cloud.height = 2;
  cloud.width = 2;
  cloud.row_step = 2 * 12 + 3;
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (const float x : {1.0F, nan}) append(cloud.data, std::array<float, 3>{x, 2, 3});
  cloud.data.append(3, '\x7f');
  for (const float x : {0.0F, 4.0F}) append(cloud.data, std::array<float, 3>{x, 0, 0});
  const DecodedScan scan = decode(cloud);
  EXPECT_THAT(scan.cloud.positions,
              ElementsAre(Eigen::Vector3f(1, 2, 3), Eigen::Vector3f(4, 0, 0)));
  EXPECT_EQ(scan.dropped.non_finite, 1U);
  EXPECT_EQ(scan.dropped.zero_range, 1U);
  EXPECT_EQ(scan.points_in_file, 4U);
  EXPECT_THAT(scan.cloud.file_indices, ElementsAre(0U, 3U));
}

TEST(PointCloud2, TakesIntensityUnderItsNames) {
  for (const char* name : {"intensity", "reflectivity", "i", "Intensity"}) {
    CloudMessage cloud;
    cloud.fields.push_back({name, 12, 4});
    cloud.fields.push_back({"ring", 14, 4});
    cloud.point_step = cloud.row_step = 16;
    append(cloud.data, std::array<float, 3>{1, 2, 3});
    append(cloud.data, std::array<std::uint16_t, 2>{200, 5});
    EXPECT_THAT(decode(cloud).cloud.intensities, ElementsAre(200.0F)) << name;
  }
}

/// Two points 0.1 s apart, of which the second has no return and no time.
template <typename Number>
CloudMessage timed(const std::string& name, std::uint8_t type, Number time) {
  CloudMessage cloud;
  cloud.stamp_ns = 1'700'000'000'123'456'789;
  const auto size = static_cast<std::uint32_t>(sizeof(Number));
  cloud.fields.push_back({name, 12, type});
  cloud.width = 2;
  cloud.point_step = 12 + size;
  cloud.row_step = 2 * cloud.point_step;
  append(cloud.data, std::array<float, 3>{1, 2, 3});
  append(cloud.data, time);
  append(cloud.data, std::array<float, 3>{0, 0, 0});
  append(cloud.data, Number{0});
  return cloud;
}

template <typename Number>
std::vector<float> times(const std::string& name, std::uint8_t type, Number time) {
  return decode(timed(name, type, time)).cloud.time_offsets_s;
}

TEST(PointCloud2, UnderstandsTimesOfTheSensors) {
  EXPECT_THAT(times("time", 7, 0.05F), ElementsAre(0.05F));  // Velodyne
  EXPECT_THAT(times("time", 7, -0.05F), ElementsAre(-0.05F));
  EXPECT_THAT(times<std::uint32_t>("t", 6, 50'000'000), ElementsAre(0.05F));            // Ouster
  EXPECT_THAT(times<std::uint32_t>("offset_time", 6, 50'000'000), ElementsAre(0.05F));  // Livox
  EXPECT_THAT(times<std::uint32_t>("time_stamp", 6, 50'000'000), ElementsAre(0.05F));   // Autoware
  EXPECT_THAT(times<std::int32_t>("time_offset_ns", 5, -50'000'000), ElementsAre(-0.05F));  // Aeva
  EXPECT_THAT(times<std::uint32_t>("point_time_offset", 6, 50'000'000),
              ElementsAre(0.05F));                                         // Blickfeld
  EXPECT_THAT(times("relative_timestamp", 7, 0.05F), ElementsAre(0.05F));  // Cepton
  // Hesai, Robosense: doubles of seconds, 0.24 us apart.
  EXPECT_THAT(times("timestamp", 8, 1'700'000'000.173456789),
              ElementsAre(::testing::FloatNear(0.05F, 3e-7F)));
  // Livox: nanoseconds, 256 apart.
  EXPECT_THAT(times("timestamp", 8, 1.7000000001734568e18),
              ElementsAre(::testing::FloatNear(0.05F, 3e-7F)));
  EXPECT_THAT(times("timestamp", 8, 1.700000000173456e15),
              ElementsAre(::testing::FloatNear(0.05F, 2e-6F)));
}

TEST(PointCloud2, LeavesOutTimesOfAnotherZero) {
  EXPECT_TRUE(times("timestamp", 8, 1'500'000'000.0).empty());
  EXPECT_TRUE(times<std::uint32_t>("t", 6, 3'000'000'000).empty());
  EXPECT_TRUE(times("time", 7, std::numeric_limits<float>::infinity()).empty());
}

TEST(PointCloud2, TakesWhatDriversLeaveZero) {
  CloudMessage cloud;
  for (auto& field : cloud.fields) field.count = 0;
  cloud.row_step = 0;
  append(cloud.data, std::array<float, 3>{1, 2, 3});
  EXPECT_EQ(decode(cloud).cloud.size(), 1U);
  CloudMessage empty;
  empty.fields.clear();
  empty.width = 0;
  EXPECT_TRUE(decode(empty).cloud.empty());
}

TEST(PointCloud2, TakesRowsWithoutGapsWhereTheirStepCannotBe) {
  // The points of a row, those of all rows, and the bytes of all rows: what drivers write.
  for (const std::uint32_t row_step : {2U, 6U, 72U}) {
    CloudMessage cloud;
    cloud.height = 3;
    cloud.width = 2;
    cloud.row_step = row_step;
    for (float x = 1; x <= 6; ++x) append(cloud.data, std::array<float, 3>{x, 2, 3});
    const PointCloud read = decode(cloud).cloud;
    ASSERT_EQ(read.size(), 6U) << row_step;
    for (std::size_t i = 0; i < 6; ++i)
      EXPECT_EQ(read.positions[i].x(), static_cast<float>(i + 1)) << row_step;
    // With a byte more it is not known where the rows are.
    cloud.data.push_back(0);
    EXPECT_THROW((void)decode(cloud), InputError) << row_step;
  }
}

TEST(PointCloud2, RefusesWhatDoesNotFit) {
  const auto refused = [](CloudMessage cloud, const std::vector<std::string>& texts) {
    EXPECT_THAT([&] { (void)decode(cloud); }, ThrowsSaying<InputError>(texts));
  };
  CloudMessage cloud;
  append(cloud.data, std::array<float, 3>{1, 2, 3});
  ASSERT_EQ(decode(cloud).cloud.size(), 1U);
  CloudMessage broken = cloud;
  broken.data.pop_back();
  refused(broken, {"11 bytes of points", "12"});
  broken = cloud;
  broken.fields[2].offset = 9;
  refused(broken, {"field 'z'", "point_step of 12"});
  broken = cloud;
  broken.fields[2].count = 0xFFFFFFFF;
  refused(broken, {"field 'z'"});
  broken = cloud;
  broken.fields[1].type = 9;
  refused(broken, {"datatype 9 of field 'y'"});
  broken = cloud;
  broken.fields[1].name = "x";
  refused(broken, {"one field 'x'"});
  broken = cloud;
  broken.width = broken.height = 0xFFFFFFFF;
  refused(broken, {"18446744065119617025 points", "1000"});
  broken = cloud;
  broken.height = 2;
  broken.row_step = 11;
  refused(broken, {"row_step 11"});
  broken = cloud;
  broken.width = 500;
  broken.point_step = 0xFFFFFFFF;
  refused(broken, {"12 bytes of points"});
}

TEST(PointCloud2, RefusesEveryCut) {
  CloudMessage cloud;
  append(cloud.data, std::array<float, 3>{1, 2, 3});
  const std::string whole = cloud.str();
  // The last byte, is_dense, is not looked at.
  for (std::size_t size = 0; size + 1 < whole.size(); ++size) {
    const std::string bytes = whole.substr(0, size);
    EXPECT_THROW(
        {
          MessageReader reader(test::as_bytes(bytes), Serialization::kCdr, "cloud");
          (void)decode_point_cloud2(reader);
        },
        InputError)
        << size;
  }
}

}  // namespace point_cloud2_test
}  // namespace stillmap::maps
