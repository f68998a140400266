#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>

#include <cmath>
#include <cstring>
#include <string>

#include "packets/ouster_sweep.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace ouster_test {

using test::ThrowsSaying;
using ::testing::ElementsAre;
using ::testing::FloatNear;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr std::int64_t kStampNs = 1'700'000'000'000'000'000;

/// Of a sensor of two pixels, 1024 columns a turn and two a packet.
std::string metadata(const std::string& profile) {
  return R"({"beam_intrinsics": {"beam_altitude_angles": [30, 0], "beam_azimuth_angles": [0, 90],
    "lidar_origin_to_beam_origin_mm": 15.8}, "lidar_intrinsics": {"lidar_to_sensor_transform":
    [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 36.2, 0, 0, 0, 1]}, "lidar_data_format":
    {"columns_per_frame": 1024, "columns_per_packet": 2, "pixels_per_column": 2,
    "udp_profile_lidar": ")" +
         profile + "\"}, \"sensor_info\": {\"prod_line\": \"OS-1-2\"}}";
}

OusterSensor sensor(const std::string& profile) {
  return read_ouster_metadata(metadata(profile), "metadata");
}

/// A packet with both columns valid and no return.
struct Packet {
  explicit Packet(const OusterSensor& of) : sensor(&of), bytes(of.packet_bytes(), std::byte{0}) {
    put<std::uint16_t>(of.has_packet_header() ? 2 : 10, 77);
    if (of.has_packet_header()) put<std::uint16_t>(0, 1);
    for (std::size_t i = 0; i < 2; ++i) {
      put<std::int64_t>(column(i), kStampNs + static_cast<std::int64_t>(i) * 100'000);
      if (of.has_packet_header())
        put<std::uint16_t>(column(i) + 10, 1);
      else
        put<std::uint32_t>(column(i + 1) - 4, 0xffffffffU);
    }
  }
  [[nodiscard]] std::size_t column(std::size_t i) const {
    return sensor->packet_header_bytes() + i * sensor->column_bytes();
  }
  [[nodiscard]] std::size_t pixel(std::size_t column_i, std::size_t i) const {
    return column(column_i) + sensor->column_header_bytes() + i * sensor->profile->pixel_bytes;
  }
  template <typename Number>
  void put(std::size_t at, Number value) {
    std::memcpy(&bytes[at], &value, sizeof(Number));
  }
  const OusterSensor* sensor;
  std::vector<std::byte> bytes;
};

DecodedScan decoded(const Packet& packet) {
  OusterSweep sweep(*packet.sensor, kStampNs, "a sweep");
  sweep.add(packet.bytes);
  return std::move(sweep).finish();
}

::testing::Matcher<const Eigen::Vector3f&> IsAt(float x, float y, float z) {
  return ::testing::Truly(
      [=](const Eigen::Vector3f& p) { return (p - Eigen::Vector3f(x, y, z)).norm() < 1e-4F; });
}

// The sensor's x points away from column 0, which looks at the connector (sensor documentation,
// "Sensor coordinate frame").
TEST(Ouster, PointsStandWhereTheDocumentationSays) {
  const OusterSensor os = sensor("RNG19_RFL8_SIG16_NIR16");
  Packet packet(os);
  packet.put<std::uint16_t>(packet.column(1) + 8, 256);
  // 10 m up by 30 deg, of column 0: the beam begins 15.8 mm beside the axis.
  packet.put<std::uint32_t>(packet.pixel(0, 0), 10'000);
  packet.put<std::uint16_t>(packet.pixel(0, 0) + 6, 500);
  // Flat, 90 deg clockwise of column 256, which looks to the sensor's left.
  packet.put<std::uint32_t>(packet.pixel(1, 1), 20'000);
  packet.put<std::uint8_t>(packet.pixel(1, 1) + 4, 99);
  const DecodedScan scan = decoded(packet);
  const float flat = (10.0F - 0.0158F) * std::sqrt(0.75F) + 0.0158F;
  const float up = (10.0F - 0.0158F) * 0.5F + 0.0362F;
  EXPECT_THAT(scan.cloud.positions,
              ElementsAre(IsAt(-flat, 0.0F, up), IsAt(20.0F - 0.0158F, 0.0158F, 0.0362F)));
  EXPECT_THAT(scan.cloud.intensities, ElementsAre(500.0F, 0.0F));
  EXPECT_THAT(scan.cloud.time_offsets_s, ElementsAre(0.0F, FloatNear(1e-4F, 1e-9F)));
  EXPECT_EQ(scan.points_in_file, 4U);
  EXPECT_EQ(ouster_packet_head(packet.bytes, packet.bytes.size())->turn, 77);
  EXPECT_EQ(ouster_packet_head(packet.bytes, packet.bytes.size())->stamp_ns, kStampNs);
}

TEST(Ouster, ProfilesPackPixelsInTheirOwnWay) {
  struct Case {
    const char* profile;
    std::size_t packet_bytes;
    std::vector<float> ranges;
    std::vector<float> intensities;
  };
  // Every byte of the pixel differs, so that a wrong place shows.
  for (const Case& each : {
           Case{"LEGACY", 2 * (16 + 2 * 12 + 4), {0x04030201 & 0xfffff}, {0x0807}},
           Case{"RNG19_RFL8_SIG16_NIR16", 64 + 2 * (12 + 2 * 12), {0x04030201 & 0x7ffff}, {0x0807}},
           Case{"RNG19_RFL8_SIG16_NIR16_DUAL",
                64 + 2 * (12 + 2 * 16),
                {0x04030201 & 0x7ffff, 0x08070605 & 0x7ffff},
                {0x0a09, 0x0c0b}},
           Case{"RNG15_RFL8_NIR8", 64 + 2 * (12 + 2 * 4), {8 * 0x0201}, {0x03}},
           Case{"RNG15_RFL8_NIR8_DUAL",
                64 + 2 * (12 + 2 * 8),
                {8 * 0x0201, 8 * 0x0605},
                {0x03, 0x07}},
       }) {
    SCOPED_TRACE(each.profile);
    const OusterSensor os = sensor(each.profile);
    EXPECT_EQ(os.packet_bytes(), each.packet_bytes);
    Packet packet(os);
    for (std::size_t i = 0; i < os.profile->pixel_bytes; ++i)
      packet.put<std::uint8_t>(packet.pixel(0, 1) + i, static_cast<std::uint8_t>(i + 1));
    const DecodedScan scan = decoded(packet);
    ASSERT_THAT(scan.cloud.positions, SizeIs(each.ranges.size()));
    EXPECT_EQ(scan.cloud.intensities, each.intensities);
    for (std::size_t i = 0; i < each.ranges.size(); ++i)
      EXPECT_NEAR(scan.cloud.positions[i].y(), each.ranges[i] / 1000.0F - 0.0158F, 2e-4F);
  }
}

TEST(Ouster, ColumnsThatAreNotValidAreLeftOut) {
  for (const char* profile : {"LEGACY", "RNG15_RFL8_NIR8"}) {
    const OusterSensor os = sensor(profile);
    Packet packet(os);
    packet.put<std::uint32_t>(packet.pixel(0, 1), 1000);
    packet.put<std::uint32_t>(packet.pixel(1, 1), 1000);
    if (os.has_packet_header())
      packet.put<std::uint16_t>(packet.column(0) + 10, 0);
    else
      packet.put<std::uint32_t>(packet.column(1) - 4, 0);
    EXPECT_THAT(decoded(packet).cloud.time_offsets_s, ElementsAre(FloatNear(1e-4F, 1e-9F)));
  }
}

TEST(Ouster, HeadsAreReadWithoutTheMetadata) {
  const OusterSensor os = sensor("RNG15_RFL8_NIR8");
  Packet packet(os);
  packet.put<std::uint16_t>(0, 2);
  EXPECT_FALSE(ouster_packet_head(packet.bytes, packet.bytes.size()));
  EXPECT_FALSE(ouster_packet_head(packet.bytes, 48));  // of the IMU
  // 64 pixels in the old profile.
  const OusterSensor old_sensor = sensor("LEGACY");
  const Packet old(old_sensor);
  ASSERT_TRUE(ouster_packet_head(old.bytes, 12'608));
  EXPECT_EQ(ouster_packet_head(old.bytes, 12'608)->turn, 77);
  EXPECT_EQ(ouster_packet_head(old.bytes, 12'608)->stamp_ns, kStampNs);
}

TEST(Ouster, TimesFarFromTheStampAreLeftOut) {
  const OusterSensor os = sensor("RNG15_RFL8_NIR8");
  Packet packet(os);
  packet.put<std::uint32_t>(packet.pixel(0, 1), 1000);
  packet.put<std::int64_t>(packet.column(1), 7);
  const DecodedScan scan = decoded(packet);
  EXPECT_THAT(scan.cloud.time_offsets_s, IsEmpty());
  EXPECT_THAT(scan.times_note, ::testing::HasSubstr("lies -1700000000.0 s from its stamp"));
}

TEST(Ouster, FlatMetadataOfOldDriversIsRead) {
  const OusterSensor os = read_ouster_metadata(
      R"({"beam_altitude_angles": [1, 0], "beam_azimuth_angles": [3, -3], "lidar_mode": "2048x10",
          "prod_line": "OS-0-2", "lidar_to_sensor_transform":
          [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 36.18, 0, 0, 0, 1]})",
      "metadata.json");
  EXPECT_EQ(os.columns, 2048U);
  EXPECT_EQ(os.packet_columns, 16U);
  EXPECT_EQ(os.profile->name, "LEGACY");
  EXPECT_DOUBLE_EQ(os.beam_x_m, 0.02767);
}

TEST(Ouster, MetadataThatIsBrokenIsRefused) {
  const auto expect = [](std::string text, const std::string& from, const std::string& to,
                         const std::vector<std::string>& said) {
    const std::size_t at = text.find(from);
    ASSERT_NE(at, std::string::npos);
    text.replace(at, from.size(), to);
    EXPECT_THAT([&] { (void)read_ouster_metadata(text, "os.json"); },
                ThrowsSaying<InputError>(said));
  };
  const std::string good = metadata("RNG15_RFL8_NIR8");
  expect(good, "[30, 0]", "[30]", {"os.json", "beam_azimuth_angles", "as many as"});
  expect(good, "[30, 0]", "[30, 1e9]", {"beam_altitude_angles[1]", "-180"});
  expect(good, "_per_column\": 2", "_per_column\": 3", {"pixels_per_column", "expected 2"});
  expect(good, "RNG15_RFL8_NIR8", "RNG99", {"udp_profile_lidar", "RNG99", "PointCloud2"});
  expect(good, "36.2, 0, 0, 0, 1]", "36.2, 0, 0, 0]", {"lidar_to_sensor_transform"});
  expect(good, "[-1, 0, 0, 0, 0, -1", "[-2, 0, 0, 0, 0, -1", {"a rotation and a shift in mm"});
  expect(good, "\"columns_per_packet\": 2", "\"columns_per_packet\": 8000", {"datagram"});
  expect(good, "{", "", {"os.json", "JSON"});
}

TEST(Ouster, PacketsOfAnotherSizeAreRefused) {
  const OusterSensor os = sensor("RNG15_RFL8_NIR8");
  const Packet packet(os);
  OusterSweep sweep(os, kStampNs, "run.bag /ouster/lidar_packets 0");
  for (std::size_t bytes = 0; bytes < packet.bytes.size(); ++bytes)
    EXPECT_THAT([&] { sweep.add(std::span(packet.bytes).first(bytes)); },
                ThrowsSaying<InputError>({"lidar_packets", std::to_string(bytes) + " bytes",
                                          "104 bytes", "RNG15_RFL8_NIR8"}));
}

}  // namespace ouster_test
}  // namespace stillmap::maps
