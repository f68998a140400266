#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/lidar_set.hpp>
#include <stillmap/maps/recording_choice.hpp>

#include <cmath>
#include <limits>

#include "scan_bytes.hpp"
#include "support/bag_bytes.hpp"
#include "support/message_bytes.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace joined_lidars_test {

using test::McapBytes;
using test::ThrowsSaying;
using test::xyzi;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

/// Behind by 2 m, turned by half a turn, and its clock 10 ms behind.
MountedLidar rear() {
  MountedLidar lidar{"rear", Eigen::Isometry3d::Identity(), 0.01};
  lidar.T_reference_lidar.translation() << -2.0, 0.0, 0.5;
  lidar.T_reference_lidar.linear() << -1, 0, 0, 0, -1, 0, 0, 0, 1;
  return lidar;
}

/// 1700000000.0 s and every 100 ms after it; the rear lidar 30 ms later, and one sweep less.
class LidarSet : public ::testing::Test {
 protected:
  LidarSet() {
    for (int i = 0; i < 4; ++i) {
      folder_.write("front/" + stamp(100 * i) + ".bin",
                    xyzi(1, 0, 0, 9) + xyzi(kNaN, 0, 0, 0) + xyzi(2, 0, 0, 8));
      if (i != 2) folder_.write("rear/" + stamp(100 * i + 30) + ".bin", xyzi(3, 0, 0, 7));
    }
    write({{"front"}, rear()});
  }
  void write(const std::vector<MountedLidar>& lidars) {
    folder_.write("lidars.json", lidar_set_text(lidars));
  }
  [[nodiscard]] Drive open() const { return Drive::open(folder_.path()); }
  static std::string stamp(int ms) {
    return std::to_string(1'700'000'000'000'000'000 + std::int64_t{1'000'000} * ms);
  }
  test::TemporaryFolder folder_{test::memory_folder()};
};

TEST_F(LidarSet, PutsSweepsOfOneTimeIntoOneScan) {
  const Drive drive = open();
  ASSERT_EQ(drive.size(), 4U);
  EXPECT_THAT(drive.contents().lidars, ElementsAre("front", "rear"));
  const Scan scan = drive.read(1);
  ASSERT_EQ(scan.cloud.size(), 3U);
  EXPECT_EQ(scan.cloud.positions[2], Eigen::Vector3f(-5.0F, 0.0F, 0.5F));
  EXPECT_THAT(scan.cloud.intensities, ElementsAre(9, 8, 7));
  EXPECT_THAT(scan.cloud.lidars, ElementsAre(0, 0, 1));
  EXPECT_EQ(scan.cloud.origin_of(2), Eigen::Vector3f(-2.0F, 0.0F, 0.5F));
  EXPECT_EQ(scan.cloud.ray(2), Eigen::Vector3f(-3.0F, 0.0F, 0.0F));
  EXPECT_THAT(scan.cloud.time_offsets_s, ElementsAre(0.0F, 0.0F, 0.04F));
}

TEST_F(LidarSet, CountsPointsAsIfTheFilesWereOne) {
  const Scan scan = open().read(0);
  EXPECT_EQ(scan.points_in_file, 4U);
  EXPECT_EQ(scan.dropped.non_finite, 1U);
  EXPECT_THAT(scan.cloud.file_indices, ElementsAre(0, 2, 3));
}

TEST_F(LidarSet, SaysWhatHasNoPartner) {
  const Drive drive = open();
  EXPECT_THAT(drive.contents().notes, Contains(HasSubstr("1 of 4 scans of front have no sweep")));
  const Scan alone = drive.read(2);
  EXPECT_THAT(alone.cloud.lidars, ElementsAre(0, 0));
  EXPECT_EQ(alone.cloud.lidar_origins.size(), 2U);
}

TEST_F(LidarSet, OneLidarsPointsAreAsItSawThem) {
  const PointCloud cloud = open().read(0).cloud.of_lidar(1);
  EXPECT_THAT(cloud.positions, ElementsAre(Eigen::Vector3f(-3.0F, 0.0F, 0.0F)));
  EXPECT_THAT(cloud.lidars, IsEmpty());
  EXPECT_THAT(cloud.intensities, ElementsAre(7));
}

TEST_F(LidarSet, AnotherMountIsAnotherScan) {
  const std::string before = open().sha256(0), name = open().contents().scan_name(0);
  EXPECT_THAT(name, HasSubstr("front,rear"));
  EXPECT_EQ(open().sha256(0), before);
  MountedLidar moved = rear();
  moved.T_reference_lidar.translation().z() += 0.001;
  write({{"front"}, moved});
  EXPECT_NE(open().sha256(0), before);
  EXPECT_NE(open().contents().scan_name(0), name);
}

TEST_F(LidarSet, PosesAreTheReferences) {
  std::string poses;
  for (int i = 0; i < 4; ++i) poses += "1 0 0 " + std::to_string(i) + " 0 1 0 0 0 0 1 0\n";
  const auto file = folder_.write("given.txt", poses);
  const Drive drive = Drive::open(folder_.path(), file);
  EXPECT_EQ(drive.T_map_lidar(3).translation().x(), 3.0);
  // By a tenth of a second and not by two.
  EXPECT_EQ(Drive::open(folder_.path(), file, 100'000'000).T_map_lidar(3).translation().x(), 2.0);
}

TEST_F(LidarSet, RefusesWhatLeadsOutOfItsFolder) {
  std::filesystem::create_directory(folder_.path() / "x?");
  // It is there, so that all of the name is the place.
  const std::string around = "x?/../../" + folder_.path().filename().string() + "/front";
  for (const std::string& name :
       {std::string("../front"), std::string("/etc"), std::string("a/b"), std::string(".."),
        std::string("."), std::string(), std::string("..?cloud=/a"), around}) {
    SCOPED_TRACE(name);
    write({{name}, rear()});
    EXPECT_THAT([&] { (void)open(); }, ThrowsSaying<InputError>({"lidars.json", ".drive"}));
  }
}

TEST_F(LidarSet, RefusesClocksThatDoNotMeetAndASensorForAll) {
  MountedLidar late = rear();
  late.time_offset_s = -0.9;
  write({{"front"}, late});
  EXPECT_THAT([&] { (void)open(); },
              ThrowsSaying<InputError>({"no sweep of rear", "time_offset_s"}));
  write({{"front"}, rear()});
  EXPECT_THAT([&] { (void)Drive::open(folder_.path().string() + "?sensor=vlp-16"); },
              ThrowsSaying<InputError>({"several lidars", "lidars.json"}));
  write({{"front"}});
  EXPECT_THAT([&] { (void)open(); }, ThrowsSaying<InputError>({"array of 1", "2 to 16"}));
}

TEST_F(LidarSet, HasItsChoicesBehindEachDrive) {
  for (const char* words : {"?points=map", "?points=sensor"})
    EXPECT_THAT([&] { (void)Drive::open(folder_.path().string() + words); },
                ThrowsSaying<InputError>({"points= behind a drive of several lidars",
                                          "behind each drive's name in lidars.json"}));
  // Nobody could answer what a bag in the set asks.
  folder_.write("two.mcap", test::bag_of_two_clouds());
  MountedLidar two = rear();
  two.drive = "two.mcap?poses=none";
  write({{"front"}, two});
  const auto opened = [&] { (void)open(); };
  EXPECT_THAT(opened, ThrowsSaying<InputError>({"lidars.json",
                                                "'two.mcap?poses=none', which leaves a "
                                                "choice",
                                                "\"two.mcap?cloud=/cloud1\""}));
  EXPECT_THAT(opened, ::testing::Not(::testing::Throws<ChoiceError>()));
}

TEST(LidarSetText, IsReadBack) {
  const test::TemporaryFolder folder;
  MountedLidar tilted = rear();
  tilted.T_reference_lidar.rotate(Eigen::AngleAxisd(0.3, Eigen::Vector3d(1, 2, 3).normalized()));
  const std::vector<MountedLidar> lidars{{"a.mcap?cloud=/front"}, tilted};
  EXPECT_EQ(read_lidar_set(folder.write("lidars.json", lidar_set_text(lidars))), lidars);
}

/// Two topics of clouds, the second 20 ms later; with tf_static or without.
std::string two_clouds(bool with_tf) {
  std::string records = McapBytes::schema(1, "sensor_msgs/msg/PointCloud2") +
                        McapBytes::schema(2, "tf2_msgs/msg/TFMessage") +
                        McapBytes::channel(1, 1, "/front") + McapBytes::channel(2, 1, "/rear") +
                        McapBytes::channel(3, 2, "/tf_static");
  if (with_tf)
    records += McapBytes::message(3, test::transform(0, "base", "front", {.x = 1.0})) +
               McapBytes::message(
                   3, test::transform(0, "base", "rear", {.x = -1.0, .qz = 1.0, .qw = 0.0}));
  for (std::int64_t i = 0; i < 3; ++i) {
    const std::int64_t at_ns = 5'000'000'000 + i * 100'000'000;
    records += McapBytes::message(1, test::one_point(at_ns, 7.0F, "front")) +
               McapBytes::message(2, test::one_point(at_ns + 20'000'000, 5.0F, "rear"));
  }
  return McapBytes().add(records).finished();
}

TEST(TwoCloudsOfABag, ArePlacedByTfStatic) {
  const test::TemporaryFolder folder;
  const std::string bag = folder.write("run.mcap", two_clouds(true)).string();
  const Drive drive = Drive::open(bag + "?cloud=/front,/rear");
  ASSERT_EQ(drive.size(), 3U);
  EXPECT_EQ(drive.contents().entries.frame_id, "front");
  const PointCloud cloud = drive.read(2).cloud;
  ASSERT_EQ(cloud.size(), 2U);
  EXPECT_TRUE(cloud.positions[1].isApprox(Eigen::Vector3f(-7.0F, 0.0F, 0.0F)));
  EXPECT_TRUE(cloud.origin_of(1).isApprox(Eigen::Vector3f(-2.0F, 0.0F, 0.0F)));
  EXPECT_THAT(cloud.time_offsets_s, ElementsAre(0.0F, 0.02F));
  EXPECT_THAT([&] { (void)Drive::open(bag); }, ThrowsSaying<InputError>({"?cloud=/front,/rear"}));
  EXPECT_THAT([&] { (void)Drive::open(bag + "?cloud=/front,/left"); },
              ThrowsSaying<InputError>({"no clouds on /left"}));
}

TEST(TwoCloudsOfABag, WithoutTfSayHowToFindTheirMounts) {
  const test::TemporaryFolder folder;
  const std::string bag = folder.write("run.mcap", two_clouds(false)).string();
  EXPECT_THAT([&] { (void)Drive::open(bag + "?cloud=/front,/rear"); },
              ThrowsSaying<InputError>({"'rear' to 'front'", "stillmap calibrate"}));
  folder.write("lidars.json", lidar_set_text({{"run.mcap?cloud=/front"},
                                              {"run.mcap?cloud=/rear", rear().T_reference_lidar}}));
  EXPECT_THAT(Drive::open(folder.path()).contents().lidars,
              ElementsAre("run.mcap?cloud=/front", "run.mcap?cloud=/rear"));
}

TEST(TwoCloudsOfABag, InAFolderHaveTheirMountsBesideIt) {
  const test::TemporaryFolder folder;
  folder.write("day/run/run_0.mcap", two_clouds(false));
  const std::string day = (folder.path() / "day").string();
  for (const char* end : {"", "/"})
    EXPECT_THAT([&] { (void)Drive::open(day + "/run" + end + "?cloud=/front,/rear"); },
                ThrowsSaying<InputError>({"-o '" + day + "/lidars.json', and give '" + day + "'"}));
  folder.write("day/lidars.json", lidar_set_text({{"run?cloud=/front"},
                                                  {"run?cloud=/rear", rear().T_reference_lidar}}));
  EXPECT_EQ(Drive::open(day).contents().lidars.size(), 2U);
}

TEST(TwoCloudsOfABag, AreNamedOnceEachAndNotTooMany) {
  const test::TemporaryFolder folder;
  const std::string bag = folder.write("run.mcap", two_clouds(true)).string();
  std::string many = "/front";
  for (int i = 0; i < 16; ++i) many += ",/rear" + std::to_string(i);
  for (const std::string& topics : {std::string("/front,/front"), std::string("/front,"), many})
    EXPECT_THAT([&] { (void)Drive::open(bag + "?cloud=" + topics); },
                ThrowsSaying<InputError>({"'cloud=/front,", "2 to 16", "each once"}));
}

TEST(TwoCloudsOfABag, SayWhatIsLeftOutOfTheSecond) {
  const test::TemporaryFolder folder;
  std::string records = McapBytes::schema(1, "sensor_msgs/msg/PointCloud2") +
                        McapBytes::channel(1, 1, "/front") + McapBytes::channel(2, 1, "/rear");
  constexpr std::int64_t kEpochNs = 1'700'000'000'000'000'000;
  for (std::int64_t i = 0; i < 6; ++i) {
    const std::int64_t at_ns = kEpochNs + i * 100'000'000;
    // The rear lidar has no time at first.
    const auto recorded_ns = static_cast<std::uint64_t>(at_ns);
    records += McapBytes::message(1, test::one_point(at_ns, 7.0F), recorded_ns) +
               McapBytes::message(2, test::one_point(i < 2 ? i : at_ns, 5.0F), recorded_ns);
  }
  records += McapBytes::message(2, "cut");
  const std::string bag = folder.write("run.mcap", McapBytes().add(records).finished()).string();
  const std::vector<std::string> notes =
      Drive::open(bag + "?cloud=/front,/rear&stamps=header").contents().notes;
  EXPECT_THAT(notes, Contains(HasSubstr("/rear: 1 messages of /rear cannot be read")));
  EXPECT_THAT(notes, Contains(HasSubstr("/rear: 2 scans left out, whose stamps are of another")));
  // What is said of the bag is said once.
  const Drive by_recorder = Drive::open(bag + "?cloud=/front,/rear&stamps=recorded");
  EXPECT_THAT(by_recorder.contents().notes,
              ::testing::Not(Contains(HasSubstr("/rear: stamps are"))));
}

/// A sweep of one packet, whose first laser sees something at 10 m.
std::string velodyne_sweep(std::uint8_t model, std::int64_t stamp_ns, const std::string& frame) {
  std::string packet(1206, '\0');
  for (std::size_t block = 0; block < 12; ++block) packet.replace(block * 100, 2, "\xff\xee");
  packet.replace(4, 2, "\x88\x13");
  packet[1204] = '\x37';
  packet[1205] = static_cast<char>(model);
  test::MessageBytes message;
  message.header(stamp_ns, frame).put(std::uint32_t{1});
  message.put(static_cast<std::int32_t>(stamp_ns / 1'000'000'000));
  message.put(static_cast<std::uint32_t>(stamp_ns % 1'000'000'000));
  for (const char byte : packet) message.put(byte);
  return message.str();
}

TEST(TwoVelodynesOfABag, HaveACalibrationEachWhereItFits) {
  const test::TemporaryFolder folder;
  std::string records = McapBytes::schema(1, "velodyne_msgs/msg/VelodyneScan") +
                        McapBytes::channel(1, 1, "/vlp16") + McapBytes::channel(2, 1, "/hdl32");
  for (std::int64_t i = 0; i < 3; ++i)
    records += McapBytes::message(1, velodyne_sweep(0x22, i * 100'000'000, "lidar")) +
               McapBytes::message(2, velodyne_sweep(0x21, i * 100'000'000, "lidar"));
  const std::string bag = folder.write("run.mcap", McapBytes().add(records).finished()).string();
  std::string calibration;
  for (int i = 0; i < 16; ++i)
    calibration += "- laser_id: " + std::to_string(i) + "\n  vert_correction: 0.25\n";
  folder.write("16.yaml", calibration);
  const Drive drive = Drive::open(bag + "?cloud=/vlp16,/hdl32&calibration=16.yaml");
  const PointCloud cloud = drive.read(1).cloud;
  ASSERT_EQ(cloud.size(), 2U);
  EXPECT_NEAR(cloud.positions[0].z(), 10.0 * std::sin(0.25), 1e-3);
  EXPECT_NEAR(cloud.positions[1].z(), 10.0 * std::sin(-30.67 * M_PI / 180.0), 2e-2);
  EXPECT_THAT(drive.contents().notes,
              Contains(HasSubstr("/hdl32: 16.yaml has 16 lasers and is not used for /hdl32")));
  // One lidar alone has to be that of the calibration.
  EXPECT_THAT([&] { (void)Drive::open(bag + "?cloud=/hdl32&calibration=16.yaml").read(0); },
              ThrowsSaying<InputError>({"a calibration of 16 lasers"}));
}

}  // namespace joined_lidars_test
}  // namespace stillmap::maps
