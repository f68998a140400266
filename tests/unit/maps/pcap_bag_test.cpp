#include "bags/pcap_bag.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/recording_choice.hpp>

#include "bag_contents.hpp"
#include "bags/ros_messages.hpp"
#include "bags/velodyne_scan.hpp"
#include "support/pcap_bytes.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps::pcap {
namespace pcap_bag_test {

using test::PcapBytes;
using test::PcapngBytes;
using test::ThrowsSaying;
using test::udp_over_ipv4;
using test::vlp16_packet;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::SizeIs;

constexpr std::int64_t kStart = 1'700'000'000'000'000'000;
/// Between packets.
constexpr std::int64_t kStep = 10'000'000;
constexpr std::uint32_t kSource = 0xc0a801c9;
constexpr std::uint16_t kPort = 2368;

std::string ethernet(std::string_view payload, std::uint32_t source = kSource,
                     std::uint16_t port = kPort, std::uint16_t fragment = 0) {
  return test::link_header(1) + udp_over_ipv4(payload, source, port, fragment);
}

/// Ten packets a turn.
std::string packet(int number) {
  return vlp16_packet(static_cast<unsigned>(3600 * number % 36'000));
}

class PcapBagTest : public ::testing::Test {
 protected:
  [[nodiscard]] std::unique_ptr<PcapBag> open(const std::string& bytes) const {
    return std::make_unique<PcapBag>(folder_.write("run.pcap", bytes));
  }
  /// Packets of each sweep.
  static std::vector<std::size_t> sweeps(const PcapBag& bag) {
    std::vector<std::size_t> packets;
    for (const std::string& message : test::contents(bag)) packets.push_back(message.size() / 1214);
    return packets;
  }
  test::TemporaryFolder folder_{test::memory_folder()};
};

TEST_F(PcapBagTest, HasASweepForEachTurnInEveryByteOrderAndUnit) {
  for (const bool big : {false, true}) {
    for (const bool nanoseconds : {false, true}) {
      PcapBytes file(1, big, nanoseconds);
      for (int i = 0; i < 30; ++i) {
        file.add(kStart + i * kStep, ethernet(packet(i)));
        // Of its position, and of another device.
        file.add(kStart + i * kStep, ethernet(std::string(512, '$'), kSource, 8308));
      }
      const auto bag = open(file.str());
      ASSERT_EQ(bag->topics().size(), 1U);
      EXPECT_EQ(bag->topics()[0].name, "192.168.1.201:2368");
      EXPECT_THAT(sweeps(*bag), ElementsAre(10, 10, 10));
      EXPECT_EQ(test::visit(*bag).damage.parts, 0U);
    }
  }
}

TEST_F(PcapBagTest, AMessageIsTheScanOfItsPackets) {
  PcapBytes file;
  for (int i = 0; i < 20; ++i) file.add(kStart + i * kStep, ethernet(packet(i)));
  const auto bag = open(file.str());
  const std::string message = test::contents(*bag).at(1);
  MessageReader reader(std::as_bytes(std::span(message)), Serialization::kRos1, "scan");
  const RosHeader header = read_header(reader);
  EXPECT_EQ(header.stamp_ns, kStart + 10 * kStep);
  EXPECT_EQ(header.frame_id, "192.168.1.201:2368");
  EXPECT_EQ(reader.count(1214), 10U);
  for (int i = 10; i < 20; ++i) {
    EXPECT_EQ(read_time(reader), kStart + i * kStep);
    EXPECT_EQ(test::text_of(reader.array(1206)), packet(i));
  }
}

TEST_F(PcapBagTest, LooksThroughEveryLinkHeader) {
  for (const std::uint32_t link : {1U, 12U, 14U, 101U, 113U, 228U, 276U}) {
    for (const bool with_vlan : {false, true}) {
      PcapBytes file(link);
      for (int i = 0; i < 10; ++i)
        file.add(kStart + i * kStep, test::link_header(link, with_vlan && link != 276) +
                                         udp_over_ipv4(packet(i), kSource, kPort));
      EXPECT_THAT(sweeps(*open(file.str())), ElementsAre(10)) << link;
    }
  }
  PcapBytes wlan(105);
  wlan.add(kStart, ethernet(packet(0)));
  EXPECT_THAT([&] { (void)open(wlan.str()); },
              ThrowsSaying<InputError>({"run.pcap", "no data of a Velodyne in 1 packets",
                                        "link type 105", "1206 bytes"}));
}

TEST_F(PcapBagTest, ReadsPcapngWithItsInterfacesAndResolutions) {
  PcapngBytes file;
  file.interface(113);
  file.interface(1, file.option(2, "eth0") + file.option(9, "\x09") + file.option(0, ""));
  file.block(0x7fffffff, std::string(8, 'x'));  // of a kind that is not read
  for (int i = 0; i < 10; ++i)
    file.add(static_cast<std::uint64_t>(kStart + i * kStep), ethernet(packet(i)), 1);
  // Another section counts its interfaces anew, in units of 2^-20 s from 1,000 s.
  file.section(true);
  file.interface(1,
                 file.option(9, "\x94") + file.option(14, test::number_bytes(std::int64_t{1000})));
  for (int i = 0; i < 10; ++i)
    file.add((1'699'999'001ULL << 20U) + (static_cast<std::uint64_t>(i) << 13U),
             ethernet(packet(i)));
  const auto bag = open(file.str());
  EXPECT_THAT(sweeps(*bag), ElementsAre(10, 10));
  std::vector<std::int64_t> stamps;
  const std::vector<std::size_t> wanted{100};
  bag->visit(wanted, [&](const BagMessage& message) { stamps.push_back(message.recorded_ns); });
  EXPECT_THAT(stamps, ElementsAre(kStart, kStart + 1'000'000'000));
  const std::string second = test::contents(*bag).at(1);
  MessageReader reader(std::as_bytes(std::span(second)), Serialization::kRos1, "scan");
  const auto times = decode_velodyne_scan(reader).cloud.time_offsets_s;
  EXPECT_NEAR(times.back() - times.front(), 9.0 / 128.0 + 1.3e-3, 1e-4);
}

TEST_F(PcapBagTest, EachSensorIsATopic) {
  PcapBytes file;
  for (int i = 0; i < 20; ++i) {
    file.add(kStart + i * kStep, ethernet(packet(i)));
    file.add(kStart + i * kStep, ethernet(packet(i + 5), kSource, 2369));
    file.add(kStart + i * kStep, ethernet(packet(i), kSource + 1));
  }
  const auto path = folder_.write("run.pcap", file.str());
  const PcapBag bag(path);
  EXPECT_THAT(test::visit(bag, 1000, "192.168.1.202:2368").heads, SizeIs(2));
  EXPECT_THAT(test::visit(bag, 1000, "192.168.1.201:2369").heads, SizeIs(3));
  EXPECT_THAT([&] { (void)Drive::open(path); },
              ThrowsSaying<ChoiceError>({"192.168.1.201:2368 (2 clouds", "192.168.1.202:2368",
                                         "?cloud=192.168.1.201:2368'"}));
  const Drive drive = Drive::open(path.string() + "?cloud=192.168.1.202:2368");
  ASSERT_EQ(drive.size(), 2U);
  EXPECT_FALSE(drive.has_poses());
  EXPECT_EQ(drive.stamp_ns(1), kStart + 10 * kStep);
  EXPECT_THAT(drive.contents().notes, Contains(HasSubstr("those of the capture")));
  EXPECT_EQ(drive.read(0).points_in_file, 3840U);
  EXPECT_THAT(
      [&] { (void)Drive::open(path.string() + "?cloud=192.168.1.201:2368,192.168.1.202:2368"); },
      ThrowsSaying<InputError>({"stillmap calibrate", "lidars.json"}));
}

TEST_F(PcapBagTest, AFolderOfFilesIsADrive) {
  PcapBytes file;
  PcapngBytes next;
  next.interface(1);
  for (int i = 0; i < 10; ++i) {
    file.add(kStart + i * kStep, ethernet(packet(i)));
    next.add(static_cast<std::uint64_t>(kStart + (i + 10) * kStep) / 1000, ethernet(packet(i)));
  }
  folder_.write("run_00001.pcap", file.str());
  folder_.write("run_00002.pcap", next.str());
  EXPECT_TRUE(Drive::is_in(folder_.path()));
  EXPECT_EQ(Drive::open(folder_.path()).size(), 2U);
  EXPECT_EQ(name_of(Drive::open(folder_.path()).contents().layout), "pcap");
}

TEST_F(PcapBagTest, SweepsAlsoEndAtTheFieldOfViewAndAfterAPause) {
  PcapBytes file;
  std::int64_t stamp_ns = kStart;
  for (const unsigned azimuth : {9000U, 9240U, 26'000U, 9000U, 9240U, 9180U, 26'000U}) {
    file.add(stamp_ns, ethernet(vlp16_packet(azimuth)));
    stamp_ns += kStep;
  }
  for (const unsigned azimuth : {26'240U, 27'000U, 28'000U})
    file.add(stamp_ns += kStep + (azimuth == 26'240U ? 500'000'000 : 0),
             ethernet(vlp16_packet(azimuth)));
  // 60 hundredths of a degree back are the motor's.
  EXPECT_THAT(sweeps(*open(file.str())), ElementsAre(3, 4, 3));
}

TEST_F(PcapBagTest, LeavesOutPartsOfSweepsAtTheEnds) {
  PcapBytes file;
  for (int i = 7; i < 34; ++i) file.add(kStart + i * kStep, ethernet(packet(i)));
  const auto bag = open(file.str());
  EXPECT_THAT(sweeps(*bag), ElementsAre(10, 10));
  EXPECT_THAT(bag->notes(), Contains(HasSubstr("2 sweeps left out")));
  PcapBytes few;
  for (int i = 7; i < 9; ++i) few.add(kStart + i * kStep, ethernet(packet(i)));
  EXPECT_THAT(sweeps(*open(few.str())), ElementsAre(2));
}

TEST_F(PcapBagTest, CountsWhatItDoesNotRead) {
  PcapBytes file;
  for (int i = 0; i < 10; ++i) file.add(kStart + i * kStep, ethernet(packet(i)));
  file.add(kStart, ethernet(packet(0), kSource, kPort, 0x2000));
  file.add(kStart, ethernet(packet(0)).substr(0, 96), 1248);
  file.add(kStart, "short");
  const auto bag = open(file.str());
  EXPECT_THAT(sweeps(*bag), ElementsAre(10));
  EXPECT_THAT(bag->notes(), Contains(HasSubstr("1 fragments of larger packets, 1 packets that the "
                                               "capture shortened (record with tcpdump -s 0)")));
}

TEST_F(PcapBagTest, ReadsACutFileAsFarAsItGoes) {
  PcapBytes file;
  PcapngBytes next;
  next.interface(1);
  for (int i = 0; i < 4; ++i) {
    file.add(kStart + i * kStep, ethernet(packet(i)));
    next.add(static_cast<std::uint64_t>(kStart + i * kStep) / 1000, ethernet(packet(i)));
  }
  for (const std::string& whole : {file.str(), next.str()}) {
    const std::size_t of_record = (whole.size() - 60) / 4;
    std::size_t most = 0, told = 0;
    for (std::size_t size = 0; size < whole.size(); ++size) {
      try {
        const auto bag = open(whole.substr(0, size));
        const std::size_t packets = sweeps(*bag).at(0);
        EXPECT_LE(packets, size / of_record + 1);
        most = std::max(most, packets);
        told += test::visit(*bag).damage.parts;
      } catch (const InputError& error) {
        EXPECT_THAT(error.what(), HasSubstr("run.pcap"));
      }
    }
    EXPECT_GE(most, 3U);
    // All but a cut between two records, or in what stands behind the last packet.
    EXPECT_GE(told, 3 * (1206U + 42U));
  }
}

TEST_F(PcapBagTest, RefusesWhatIsBroken) {
  EXPECT_THAT([&] { (void)open("no capture at all"); },
              ThrowsSaying<InputError>({"run.pcap", "no capture"}));
  PcapBytes empty;
  EXPECT_THAT([&] { (void)open(empty.str()); },
              ThrowsSaying<InputError>({"no data of a Velodyne in 0 packets"}));
  PcapngBytes wrong;
  wrong.interface(1);
  wrong.add(1, ethernet(packet(0)), 7);
  EXPECT_THAT([&] { (void)open(wrong.str()); },
              ThrowsSaying<InputError>({"at byte 48: a packet of interface 7 of 1"}));
}

TEST_F(PcapBagTest, AFileThatWasCutMeanwhileIsAnError) {
  PcapBytes file;
  for (int i = 0; i < 10; ++i) file.add(kStart + i * kStep, ethernet(packet(i)));
  const auto bag = open(file.str());
  const auto place = test::visit(*bag).places.at(0);
  std::filesystem::resize_file(folder_.path() / "run.pcap", 5000);
  EXPECT_THAT([&] { (void)bag->read(place); }, ThrowsSaying<InputError>({"run.pcap", "cut off"}));
}

}  // namespace pcap_bag_test
}  // namespace stillmap::maps::pcap
