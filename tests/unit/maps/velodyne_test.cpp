#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>

#include <cmath>
#include <numbers>

#include "bags/velodyne_scan.hpp"
#include "packets/velodyne_sweep.hpp"
#include "scan_bytes.hpp"
#include "support/message_bytes.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace velodyne_test {

using test::append;
using test::ThrowsSaying;
using ::testing::ElementsAre;
using ::testing::FloatNear;
using ::testing::SizeIs;

constexpr double kRadPerDeg = std::numbers::pi / 180.0;

/// One data packet, without a return until one is set.
struct Packet {
  explicit Packet(std::uint8_t factory, std::uint8_t mode = 0x37) : bytes(1206, '\0') {
    bytes[1204] = static_cast<char>(mode);
    bytes[1205] = static_cast<char>(factory);
    for (std::size_t block = 0; block < 12; ++block) set_block(block, 0xeeff, 0);
  }
  void set_block(std::size_t block, unsigned flag, unsigned azimuth) {
    put(block * 100, flag);
    put(block * 100 + 2, azimuth);
  }
  void set(std::size_t block, std::size_t place, unsigned range, std::uint8_t intensity = 7) {
    put(block * 100 + 4 + 3 * place, range);
    bytes[block * 100 + 6 + 3 * place] = static_cast<char>(intensity);
  }
  void put(std::size_t at, unsigned value) {
    bytes[at] = static_cast<char>(value & 0xffU);
    bytes[at + 1] = static_cast<char>(value >> 8U);
  }
  std::string bytes;
};

DecodedScan decoded(const Packet& packet, double from_stamp_s = 0.0,
                    std::vector<VelodyneLaser> lasers = {}) {
  VelodyneSweep sweep(lasers, "a sweep");
  sweep.add(test::as_bytes(packet.bytes), from_stamp_s);
  return std::move(sweep).finish();
}

/// A point by its range and angles, azimuth clockwise from ahead.
::testing::Matcher<const Eigen::Vector3f&> IsAt(double range_m, double azimuth_deg,
                                                double elevation_deg) {
  const double a = azimuth_deg * kRadPerDeg, e = elevation_deg * kRadPerDeg;
  const Eigen::Vector3f p =
      Eigen::Vector3d(range_m * std::cos(e) * std::cos(a), -range_m * std::cos(e) * std::sin(a),
                      range_m * std::sin(e))
          .cast<float>();
  return ::testing::Truly([p](const Eigen::Vector3f& q) { return (p - q).norm() < 1e-3F; });
}

TEST(VelodynePacket, OfVlp16HasTwoFiringsABlockThatGoOnTurning) {
  Packet packet(0x22);
  // 0.4 deg from block to block: 0.2 deg from firing to firing.
  for (unsigned block = 0; block < 12; ++block) packet.set_block(block, 0xeeff, 9000 + 40 * block);
  packet.set(0, 1, 5000);
  packet.set(2, 16 + 15, 10'000, 200);
  const DecodedScan scan = decoded(packet, -0.05);
  EXPECT_EQ(scan.points_in_file, 12U * 32U);
  EXPECT_EQ(scan.dropped.zero_range, 12U * 32U - 2U);
  // 2.304 us of 110.592 after the block's azimuth.
  EXPECT_THAT(scan.cloud.positions,
              ElementsAre(IsAt(10.0, 90.0 + 0.4 * 2.304 / 110.592, 1.0),
                          IsAt(20.0, 90.8 + 0.2 + 0.4 * 34.56 / 110.592, 15.0)));
  EXPECT_THAT(scan.cloud.intensities, ElementsAre(7.0F, 200.0F));
  EXPECT_THAT(scan.cloud.time_offsets_s, ElementsAre(FloatNear(-0.05F + 2.304e-6F, 1e-8F),
                                                     FloatNear(-0.05F + 311.04e-6F, 1e-8F)));
  EXPECT_THAT(scan.cloud.file_indices, ElementsAre(1U, 2U * 32U + 31U));
}

TEST(VelodynePacket, OfDualReturnsCountsASameReturnOnce) {
  Packet packet(0x22, 0x39);
  for (unsigned block = 0; block < 12; ++block)
    packet.set_block(block, 0xeeff, 1000 + 40 * (block / 2));
  packet.set(2, 0, 5000);
  packet.set(3, 0, 5000);
  packet.set(2, 2, 5000);
  packet.set(3, 2, 6000);
  const DecodedScan scan = decoded(packet);
  EXPECT_THAT(scan.cloud.positions, SizeIs(3));
  EXPECT_FLOAT_EQ(scan.cloud.time_offsets_s[0], 110.592e-6F);
  EXPECT_NEAR(scan.cloud.positions[2].norm(), 12.0, 1e-5);
}

TEST(VelodynePacket, OfOtherModelsHasTheirAnglesAndTimes) {
  Packet hdl32(0x21);
  for (unsigned block = 0; block < 12; ++block) hdl32.set_block(block, 0xeeff, 0);
  hdl32.set(1, 1, 5000);
  EXPECT_THAT(decoded(hdl32).cloud.positions, ElementsAre(IsAt(10.0, 0.0, -28.0 / 3.0)));
  EXPECT_FLOAT_EQ(decoded(hdl32).cloud.time_offsets_s[0], 47.232e-6F);
  Packet vlp32(0x28);
  for (unsigned block = 0; block < 12; ++block) vlp32.set_block(block, 0xeeff, 35'000);
  vlp32.set(0, 29, 2500);
  EXPECT_THAT(decoded(vlp32).cloud.positions, ElementsAre(IsAt(10.0, 350.0 - 1.4, 15.0)));
  EXPECT_FLOAT_EQ(decoded(vlp32).cloud.time_offsets_s[0], 14 * 2.304e-6F);
  Packet vls(0xa1);
  for (unsigned block = 0; block < 12; ++block)
    vls.set_block(block, 0xeeff - 0x1100 * (block % 4), 4500);
  vls.set(6, 5, 2500);  // laser 69
  EXPECT_THAT(decoded(vls).cloud.positions, ElementsAre(IsAt(10.0, 45.0 - 2.732, -19.582)));
  EXPECT_NEAR(decoded(vls).cloud.time_offsets_s[0], 1e-6 * (53.3 + 9 * 2.665 - 8.7), 1e-10);
}

/// 0.01 deg a unit; blocks of one firing have the same azimuth.
void turn_blocks(Packet& packet, unsigned from, unsigned step, unsigned blocks_of_firing) {
  for (unsigned block = 0; block < 12; ++block)
    packet.put(block * 100 + 2, from + step * (block / blocks_of_firing));
}

TEST(VelodynePacket, GoesOnTurningWithinAFiringByEachModelsTimes) {
  const auto azimuth_deg = [](const DecodedScan& scan) {
    const Eigen::Vector3f& p = scan.cloud.positions.at(0);
    return std::atan2(-p.y(), p.x()) / static_cast<float>(kRadPerDeg);
  };
  // The last laser of the second firing; 0.4 deg from a firing's block to the next.
  Packet hi_res(0x24);
  turn_blocks(hi_res, 4000, 40, 1);
  hi_res.set(1, 15, 5000);
  EXPECT_NEAR(azimuth_deg(decoded(hi_res)), 40.4 + 0.4 * 15 * 2.304 / 110.592, 1e-3);
  Packet hdl32(0x21);
  turn_blocks(hdl32, 4000, 40, 1);
  hdl32.set(1, 31, 5000);
  EXPECT_NEAR(azimuth_deg(decoded(hdl32)), 40.4 + 0.4 * 31 * 1.152 / 46.08, 1e-3);
  Packet vlp32(0x28);
  turn_blocks(vlp32, 4000, 40, 1);
  vlp32.set(1, 31, 5000);
  EXPECT_NEAR(azimuth_deg(decoded(vlp32)), 40.4 - 1.4 + 0.4 * 15 * 2.304 / 55.296, 1e-3);
  Packet vls(0xa1);
  for (unsigned block = 0; block < 12; ++block)
    vls.set_block(block, 0xeeff - 0x1100 * (block % 4), 0);
  turn_blocks(vls, 4000, 40, 4);
  vls.set(7, 31, 5000);  // laser 127, 6.354 deg beside
  EXPECT_NEAR(azimuth_deg(decoded(vls)), 40.4 - 6.354 + 0.4 * 16 * 2.665 / 53.3, 1e-3);
}

TEST(VelodyneSweep, OfDualVls128TurnsByThePacketBefore) {
  // Two returns of 128 lasers fill a packet: its own blocks tell no rate.
  const auto packet = [](unsigned azimuth) {
    Packet dual(0xa1, 0x39);
    for (unsigned block = 0; block < 8; ++block)
      dual.set_block(block, 0xeeff - 0x1100 * (block / 2), azimuth);
    dual.set(6, 31, 5000);  // laser 127
    return dual;
  };
  // @return azimuth of the last packet's point, from its packet [deg].
  const auto turned_deg = [&](std::vector<std::pair<unsigned, double>> packets) {
    VelodyneSweep sweep({}, "a sweep");
    for (const auto& [azimuth, from_stamp_us] : packets)
      sweep.add(test::as_bytes(packet(azimuth).bytes), 1e-6 * from_stamp_us);
    const Eigen::Vector3f p = std::move(sweep).finish().cloud.positions.back();
    return std::atan2(-p.y(), p.x()) / kRadPerDeg + 6.354 - 0.01 * packets.back().first;
  };
  EXPECT_NEAR(turned_deg({{4000, 0.0}}), 0.0, 1e-3) << "nothing tells the rate";
  EXPECT_NEAR(turned_deg({{4000, 0.0}, {4019, 53.3}}), 0.19 * 16 * 2.665 / 53.3, 1e-3);
  EXPECT_NEAR(turned_deg({{4000, 0.0}, {4019, 53.3}, {4057, 160.0}}), 0.19 * 16 * 2.665 / 53.3,
              1e-3)
      << "a packet was lost";
}

TEST(VelodynePacket, OfHdl64eTakesTheCorrectionBetweenTwoDistances) {
  Packet packet('V');
  for (unsigned block = 0; block < 12; ++block)
    packet.set_block(block, block % 2 == 0 ? 0xeeff : 0xddff, 9000);
  std::vector<VelodyneLaser> lasers(64);
  lasers[0] = {.range_m = 1.2, .near_x_m = 1.0, .near_y_m = 1.1, .two_points = true};
  // At an azimuth of 90 deg the sensor's x (to the right) is the range.
  const auto right_m = [&](double range_m) {
    packet.set(0, 0, static_cast<unsigned>(std::lround(range_m / 0.002)));
    return -decoded(packet, 0.0, lasers).cloud.positions.at(0).y();
  };
  // HDL-64E S2 manual, appendix F: at 25.04 m the far correction counts, at 2.4 m the near one.
  EXPECT_NEAR(right_m(25.04 - 1.2), 25.04, 1e-4);
  EXPECT_NEAR(right_m(2.4 - 1.2), 2.4 - 0.2, 1e-4);
  EXPECT_NEAR(right_m(13.72 - 1.2), 13.72 - 0.1, 1e-4);
}

TEST(VelodynePacket, OfHdl64eNeedsTheSensorsCalibration) {
  Packet packet('V');
  for (unsigned block = 0; block < 12; ++block)
    packet.set_block(block, block % 2 == 0 ? 0xeeff : 0xddff, 18'000);
  packet.set(1, 3, 5000);
  EXPECT_THAT([&] { (void)decoded(packet); },
              ThrowsSaying<InputError>({"packets of HDL-64E", "?calibration=NAME"}));
  std::vector<VelodyneLaser> lasers(64);
  lasers[35].elevation_rad = 0.1;
  lasers[35].range_m = 0.5;
  lasers[35].vertical_offset_m = 0.2;
  const DecodedScan scan = decoded(packet, 0.0, lasers);
  ASSERT_THAT(scan.cloud.positions, SizeIs(1));
  EXPECT_NEAR(scan.cloud.positions[0].x(), -(10.5 * std::cos(0.1) - 0.2 * std::sin(0.1)), 1e-5);
  EXPECT_NEAR(scan.cloud.positions[0].z(), 10.5 * std::sin(0.1) + 0.2 * std::cos(0.1), 1e-5);
  EXPECT_THAT([&] { (void)decoded(packet, 0.0, std::vector<VelodyneLaser>(32)); },
              ThrowsSaying<InputError>({"a calibration of 32 lasers", "64 lasers"}));
  EXPECT_THAT([&] { (void)decoded(Packet(0x22), 0.0, lasers); },
              ThrowsSaying<InputError>({"packets of VLP-16", "a calibration of 64 lasers",
                                        "sensor's calibration of 16 lasers"}));
}

TEST(VelodynePacket, OfAnotherKindIsRefusedInWords) {
  EXPECT_THAT([] { (void)decoded(Packet(0x31)); },
              ThrowsSaying<InputError>({"a sweep", "factory byte 0x31", "PointCloud2"}));
  VelodyneSweep sweep({}, "a sweep");
  const Packet first(0x22), second(0x21);
  sweep.add(test::as_bytes(first.bytes), 0.0);
  EXPECT_THAT([&] { sweep.add(test::as_bytes(second.bytes), 0.0); },
              ThrowsSaying<InputError>({"VLP-16 and HDL-32E", "a topic of its own"}));
  Packet broken(0x22);
  broken.set_block(3, 0xeeff, 40'000);
  EXPECT_THAT([&] { (void)decoded(broken); }, ThrowsSaying<InputError>({"an azimuth of 40000"}));
  Packet cut(0x22);
  cut.bytes.resize(1205);
  EXPECT_THAT([&] { (void)decoded(cut); }, ThrowsSaying<InputError>({"1205 bytes", "1206"}));
}

TEST(VelodyneCalibration, IsReadInBlockAndInFlowStyle) {
  const test::TemporaryFolder folder;
  const auto block =
      folder.write("block.yaml",
                   "distance_resolution: 0.002\nlasers:\n- dist_correction: 0.1\n  laser_id: 1\n"
                   "  two_pt_correction_available: true\n  vert_correction: -0.125\n"
                   "- laser_id: 0\n  rot_correction: 0.25\nnum_lasers: 2\n");
  const auto flow = folder.write(
      "flow.yaml",
      "lasers:\n- {dist_correction: 0.1, laser_id: 1, two_pt_correction_available: true,\n"
      "  vert_correction: -0.125}\n- {laser_id: 0, rot_correction: 0.25}\n");
  for (const auto& file : {block, flow}) {
    const auto lasers = read_velodyne_calibration(file);
    ASSERT_THAT(lasers, SizeIs(2)) << file;
    EXPECT_EQ(lasers[1].elevation_rad, -0.125);
    EXPECT_EQ(lasers[1].range_m, 0.1);
    EXPECT_TRUE(lasers[1].two_points);
    EXPECT_EQ(lasers[0].azimuth_rad, 0.25);
  }
  const auto refused = [&](const std::string& text, std::initializer_list<std::string> words) {
    const auto file = folder.write("bad.yaml", text);
    EXPECT_THAT([&] { (void)read_velodyne_calibration(file); }, ThrowsSaying<InputError>(words));
  };
  refused("- laser_id: 1\n", {"bad.yaml", "no laser 0"});
  refused("- laser_id: 0\n  vert_correction: up\n", {"line 2", "'vert_correction: up'"});
  refused("- laser_id: 900\n", {"'laser_id: 900'", "below 128"});
  refused("nothing\n", {"no laser_id", "gen_calibration.py"});
}

std::string scan_message(const std::vector<std::pair<std::int64_t, Packet>>& packets,
                         std::int64_t stamp_ns, test::MessageBytes::Kind kind) {
  test::MessageBytes message(kind);
  message.header(stamp_ns, "velodyne").put(static_cast<std::uint32_t>(packets.size()));
  for (const auto& [packet_ns, packet] : packets) {
    message.put(static_cast<std::int32_t>(packet_ns / 1'000'000'000));
    message.put(static_cast<std::uint32_t>(packet_ns % 1'000'000'000));
    for (const char byte : packet.bytes) message.put(byte);
  }
  return message.str();
}

TEST(VelodyneScan, CountsTimesFromItsStampOrFromTheFirstPacketOfAnotherClock) {
  Packet packet(0x22);
  packet.set(0, 0, 5000);
  constexpr std::int64_t kStampNs = 1'700'000'000'100'000'000;
  using Kind = test::MessageBytes::Kind;
  const auto times = [&](std::int64_t first_ns, Kind kind) {
    const std::string bytes =
        scan_message({{first_ns, packet}, {first_ns + 1'327'000, packet}}, kStampNs, kind);
    MessageReader reader(test::as_bytes(bytes),
                         kind == Kind::kRos1 ? Serialization::kRos1 : Serialization::kCdr, "scan");
    return decode_velodyne_scan(reader).cloud.time_offsets_s;
  };
  for (const Kind kind : {Kind::kLittleEndian, Kind::kBigEndian, Kind::kRos1}) {
    EXPECT_THAT(times(kStampNs - 100'000'000, kind),
                ElementsAre(FloatNear(-0.1F, 1e-7F), FloatNear(-0.098673F, 1e-7F)));
    EXPECT_THAT(times(5'000'000'000, kind), ElementsAre(0.0F, FloatNear(0.001327F, 1e-8F)));
  }
}

TEST(VelodyneScan, IsRefusedWhereItIsCutAtAnyByte) {
  using Kind = test::MessageBytes::Kind;
  // CDR fills up each packet to the next one's stamp.
  for (const auto& [kind, serialization] :
       {std::pair{Kind::kRos1, Serialization::kRos1}, {Kind::kLittleEndian, Serialization::kCdr}}) {
    const std::string whole = scan_message({{5, Packet(0x22)}, {6, Packet(0x22)}}, 5, kind);
    for (std::size_t size = 0; size < whole.size(); ++size) {
      const std::string cut = whole.substr(0, size);
      EXPECT_THROW(
          {
            MessageReader reader(test::as_bytes(cut), serialization, "cut");
            (void)decode_velodyne_scan(reader);
          },
          InputError)
          << size;
    }
  }
}

TEST(VelodyneScan, HasABoundOnItsPoints) {
  const std::string bytes =
      scan_message({{5, Packet(0x22)}, {6, Packet(0x22)}}, 5, test::MessageBytes::Kind::kRos1);
  const auto decode = [&](std::size_t max_points) {
    MessageReader reader(test::as_bytes(bytes), Serialization::kRos1, "/packets 3");
    return decode_velodyne_scan(reader, {}, max_points);
  };
  EXPECT_EQ(decode(768).points_in_file, 768U);
  EXPECT_THAT([&] { (void)decode(767); },
              ThrowsSaying<InputError>({"/packets 3", "768 points", "at most 767"}));
}

}  // namespace velodyne_test
}  // namespace stillmap::maps
