#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/drive_check.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/geodesy.hpp>
#include <stillmap/maps/imu.hpp>
#include <stillmap/maps/recording_choice.hpp>

#include <fmt/format.h>

#include "store/archive.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <numbers>

#include "support/bag_bytes.hpp"
#include "support/message_bytes.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace drive_bag_test {

using test::McapBytes;
using test::odometry;
using test::one_point;
using test::ThrowsSaying;
using ::testing::Contains;
using ::testing::DoubleNear;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

constexpr std::int64_t kStart = 1'700'000'000'000'000'000;
constexpr std::int64_t kStep = 100'000'000;
const char* const kCloudType = "sensor_msgs/msg/PointCloud2";
const char* const kOdometryType = "nav_msgs/msg/Odometry";
const char* const kPoseType = "geometry_msgs/msg/PoseStamped";
const char* const kTfType = "tf2_msgs/msg/TFMessage";
const char* const kFixType = "sensor_msgs/msg/NavSatFix";

struct Message {
  std::string topic;
  std::string type;
  std::string bytes;
};

/// Lines of `inspect`, and the drive.
class BagDrive : public ::testing::Test {
 protected:
  BagDrive() {
    for (int i = 0; i < 4; ++i) clouds("/points", i);
  }
  void clouds(const std::string& topic, int i, const std::string& frame = "lidar") {
    add(topic, kCloudType, one_point(kStart + i * kStep, static_cast<float>(i + 1), frame));
  }
  void add(const std::string& topic, const std::string& type, const std::string& bytes) {
    messages_.push_back({topic, type, bytes});
  }
  /// Poses of `child` along x, 10 m/s, half a step beside the scans.
  void add_odometry(const std::string& topic = "/odom", const std::string& child = "lidar") {
    for (int i = -1; i <= 4; ++i)
      add(topic, kOdometryType, odometry(kStart + i * kStep + kStep / 2, {i + 0.5, 0, 0}, child));
  }
  void add_static(const std::string& parent, const std::string& child,
                  const test::PoseValues& pose) {
    add("/tf_static", kTfType, test::transform(0, parent, child, pose));
  }

  static std::string mcap_of(const std::vector<Message>& messages) {
    McapBytes mcap;
    auto recorded_ns = static_cast<std::uint64_t>(kStart);
    std::vector<std::string> topics;
    for (const Message& message : messages) {
      auto topic = std::find(topics.begin(), topics.end(), message.topic);
      const auto id = static_cast<std::uint16_t>(topic - topics.begin() + 1);
      if (topic == topics.end()) {
        topics.push_back(message.topic);
        mcap.add(McapBytes::schema(id, message.type) + McapBytes::channel(id, id, message.topic));
      }
      mcap.add(McapBytes::message(id, message.bytes, recorded_ns));
      recorded_ns += static_cast<std::uint64_t>(kStep);
    }
    return mcap.finished();
  }
  static void write_sqlite(const std::filesystem::path& file,
                           const std::vector<Message>& messages) {
    test::SqliteFile bag(file);
    bag.make_tables();
    std::vector<std::string> topics;
    for (const Message& message : messages) {
      const auto topic = std::find(topics.begin(), topics.end(), message.topic);
      const auto id = static_cast<int>(topic - topics.begin() + 1);
      if (topic == topics.end()) {
        topics.push_back(message.topic);
        bag.topic(id, message.topic, message.type);
      }
      bag.message(id, message.bytes);
    }
  }
  static std::string bytes_of(const std::filesystem::path& file) {
    std::ifstream stream(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
  }
  [[nodiscard]] maps::Drive open(const std::string& words = "") const {
    const std::filesystem::path file = folder_.write("run.mcap", mcap_of(messages_));
    return maps::Drive::open(file.string() + words);
  }
  void expect_error(const std::vector<std::string>& texts, const std::string& words = "") const {
    EXPECT_THAT([&] { (void)open(words); }, ThrowsSaying<maps::InputError>(texts));
  }
  static std::vector<double> xs(const maps::Drive& drive) {
    std::vector<double> values;
    for (const Eigen::Isometry3d& T : drive.contents().T_map_lidar)
      values.push_back(T.translation().x());
    return values;
  }

  test::TemporaryFolder folder_{test::memory_folder()};
  std::vector<Message> messages_;
};

TEST_F(BagDrive, SaysAllThatCanBeChosenWhereSomethingHasToBe) {
  for (int i = 0; i < 2; ++i) clouds("/rear", i, "rear");
  add("/odd", kCloudType, one_point(kStart, 1.0F, "a"));
  add("/odd", kCloudType, one_point(kStart + kStep, 1.0F, "b"));
  add_odometry();
  add("/tf", kTfType, test::transform(kStart, "map", "odom", {}));
  add_static("base_link", "lidar", {});
  add("/fix", kFixType, "anything");
  std::vector<std::string> found;
  try {
    (void)open();
  } catch (const maps::ChoiceError& error) {
    for (const maps::RecordingTopic& topic : error.topics())
      found.push_back(
          fmt::format("{}={} {} '{}'", topic.word, topic.name, topic.messages, topic.frame_id));
  }
  EXPECT_THAT(found, ElementsAre("cloud=/points 4 'lidar'", "cloud=/rear 2 'rear'",
                                 "poses=/odom 6 'lidar'", "poses=/tf 1 ''", "gnss=/fix 0 ''"));
  EXPECT_EQ(open("?cloud=/rear&poses=none").size(), 2U);
}

TEST_F(BagDrive, AsksForNoChoiceThatWouldNotHelp) {
  messages_.clear();
  clouds("/points", 0, "a");
  clouds("/points", 1, "b");
  add_odometry();
  const auto opened = [&] { (void)open(); };
  EXPECT_THAT(opened, ::testing::Throws<maps::InputError>());
  EXPECT_THAT(opened, Not(::testing::Throws<maps::ChoiceError>()));
}

TEST_F(BagDrive, ReadsTheOneTopicOfCloudsWithTheStampsOfItsHeaders) {
  add("/imu", "sensor_msgs/msg/Imu", "anything");
  const maps::Drive drive = open();
  EXPECT_EQ(drive.contents().layout, maps::DriveLayout::kMcap);
  EXPECT_THAT(drive.contents().stamps_ns,
              ElementsAre(kStart, kStart + kStep, kStart + 2 * kStep, kStart + 3 * kStep));
  EXPECT_FALSE(drive.relative_clock());
  EXPECT_FALSE(drive.has_poses());
  const maps::Scan scan = drive.read(2);
  EXPECT_EQ(scan.index, 2U);
  EXPECT_EQ(scan.stamp_ns, kStart + 2 * kStep);
  EXPECT_THAT(scan.cloud.positions, ElementsAre(Eigen::Vector3f(3, 0, 0)));
  EXPECT_THAT(scan.source, HasSubstr("run.mcap /points 2"));
  EXPECT_TRUE(drive.read_labels(0).empty());
}

TEST_F(BagDrive, MarksClocksThatStartWithTheDrive) {
  messages_.clear();
  add("/points", kCloudType, one_point(5, 1));
  EXPECT_TRUE(open().relative_clock());
}

TEST_F(BagDrive, ListsTopicsOfCloudsAndTakesTheChosenOne) {
  clouds("/rear", 9, "rear_lidar");
  expect_error({"/points (4 clouds in 'lidar')", "/rear (1 clouds in 'rear_lidar')",
                "run.mcap?cloud=/points"});
  EXPECT_EQ(open("?cloud=/rear").size(), 1U);
  EXPECT_EQ(open("?cloud=/points").size(), 4U);
  expect_error({"no clouds on /front", "/rear of sensor_msgs/msg/PointCloud2"}, "?cloud=/front");
  expect_error({"'clod=/points'", "cloud=TOPIC"}, "?clod=/points");
  expect_error({"'cloud=/rear'", "each once"}, "?cloud=/points&cloud=/rear");
}

TEST_F(BagDrive, SaysWhatThereIsInABagWithoutClouds) {
  messages_.clear();
  add("/imu", "sensor_msgs/msg/Imu", "anything");
  expect_error({"no clouds", "/imu of sensor_msgs/msg/Imu", "expected messages of"});
}

TEST_F(BagDrive, SaysWhyCloudsCannotBeRead) {
  messages_.clear();
  add("/points", kCloudType, test::packed(one_point(kStart, 1), "zstd"));
  add("/points", kCloudType, test::packed(one_point(kStart + kStep, 1), "zstd"));
  expect_error({"no clouds", "2 messages of /points cannot be read", "packed with zstd",
                "ros2 bag convert"});
  clouds("/points", 3);
  EXPECT_THAT(open().contents().notes,
              Contains(HasSubstr("2 messages of /points cannot be read, the first: /points")));
}

TEST_F(BagDrive, LeavesOutScansInGapsOfThePosesWhileTheSensorMoved) {
  for (int i = 4; i < 30; ++i) clouds("/points", i);
  for (const int i : {0, 1, 2, 3, 20, 21, 29})
    add("/odom", kOdometryType, odometry(kStart + i * kStep, {1.0 * i, 0, 0}, "lidar"));
  const maps::Drive drive = open();
  EXPECT_EQ(drive.size(), 14U);
  EXPECT_THAT(drive.contents().notes,
              Contains("16 scans left out, which lie in gaps of over 1 s between poses of /odom "
                       "while the sensor moved; to keep them, give poses without gaps"));
}

TEST_F(BagDrive, InterpolatesPosesToTheScans) {
  add_odometry();
  const maps::Drive drive = open();
  ASSERT_EQ(drive.size(), 4U);
  for (std::size_t i = 0; i < 4; ++i) EXPECT_NEAR(xs(drive)[i], static_cast<double>(i), 1e-12);
  EXPECT_THAT(drive.contents().notes, ElementsAre("poses are those of /odom"));
  EXPECT_FALSE(open("?poses=none").has_poses());
}

TEST_F(BagDrive, LeavesOutScansAtTheEndsThatHaveNoPose) {
  for (const int i : {1, 2, 3}) clouds("/points", i + 10);
  add_odometry();
  const maps::Drive drive = open();
  EXPECT_THAT(drive.contents().notes, Contains("3 scans left out, which have no pose of /odom"));
  EXPECT_EQ(drive.size(), 4U);
  EXPECT_EQ(drive.read(3).cloud.positions[0].x(), 4.0F);
  messages_.erase(messages_.begin(), messages_.begin() + 4);
  expect_error({"no pose of /odom within 0.2 s of any scan", "poses=none"});
}

TEST_F(BagDrive, BringsPosesToTheCloudsFrame) {
  add_odometry("/odom", "base_link");
  add_static("base_link", "mount", {0, 0, 1});
  // Half a turn about z.
  add_static("mount", "lidar", {2, 0, 0, 0, 0, 1, 0});
  const maps::Drive drive = open();
  const Eigen::Isometry3d& T = drive.T_map_lidar(1);
  EXPECT_NEAR((T.translation() - Eigen::Vector3d(3, 0, 1)).norm(), 0, 1e-12);
  EXPECT_NEAR((T * Eigen::Vector3d(1, 0, 0)).x(), 2.0, 1e-12);
  // The same frames the other way round.
  EXPECT_NEAR(open("?pose_frame=mount").T_map_lidar(1).translation().z(), 0.0, 1e-12);
  EXPECT_NEAR(xs(open("?pose_frame=lidar"))[1], 1.0, 1e-12);
}

TEST_F(BagDrive, ListsFramesWhereNoChainLeadsToTheClouds) {
  add_odometry("/odom", "base_link");
  add_static("base_link", "camera", {});
  expect_error({"no transform in tf_static from 'base_link' of the poses on /odom to 'lidar'",
                "'base_link', 'camera'", "run.mcap?pose_frame=lidar"});
  EXPECT_NEAR(xs(open("?pose_frame=lidar"))[1], 1.0, 1e-12);
}

TEST_F(BagDrive, TakesPosesWithoutAFrameAsTheCloudsWhereThatIsTheOnlyChoice) {
  for (int i = 0; i < 4; ++i)
    add("/pose", kPoseType, test::pose_stamped(kStart + i * kStep, {1.0 * i}));
  EXPECT_THAT(xs(open()), ElementsAre(0.0, 1.0, 2.0, 3.0));
  EXPECT_THAT(open().contents().notes, Contains(HasSubstr("taken as those of 'lidar'")));
  add_static("base_link", "lidar", {0, 0, 1});
  expect_error({"poses on /pose that name no frame", "'base_link', 'lidar'", "pose_frame=lidar"});
  EXPECT_EQ(open("?pose_frame=base_link").T_map_lidar(0).translation().z(), 1.0);
}

TEST_F(BagDrive, ListsTopicsOfPosesAndTakesTheChosenOne) {
  add_odometry("/odom");
  add_odometry("/fused");
  // A goal is no path.
  add("/goal", kPoseType, test::pose_stamped(kStart, {}));
  expect_error({"/fused (6 nav_msgs/msg/Odometry), /odom (6 nav_msgs/msg/Odometry)",
                "run.mcap?poses=/fused", "poses=none"});
  EXPECT_THAT(open("?poses=/odom").contents().notes, Contains("poses are those of /odom"));
  expect_error({"no poses on /points; there are /fused"}, "?poses=/points");
}

TEST_F(BagDrive, LeavesOutPosesThatAreNone) {
  add("/odom", kOdometryType, odometry(kStart, {0, 0, 0, 0, 0, 0, 0}, "lidar"));
  add_odometry();
  EXPECT_NEAR(xs(open())[0], 0.0, 1e-12);
  EXPECT_THAT(open().contents().notes, Contains(HasSubstr("1 poses of /odom left out")));
}

TEST_F(BagDrive, MultipliesTransformsOfTfFromAStandingFrame) {
  add_static("base_link", "lidar", {0, 0, 1});
  for (int i = -1; i <= 4; ++i) {
    const std::int64_t stamp = kStart + i * kStep + kStep / 2;
    add("/tf", kTfType, test::transform(stamp, "odom", "base_link", {i + 0.5, 0, 0}));
    add("/tf", kTfType, test::transform(stamp + 7, "map", "odom", {0, 5, 0}));
    add("/tf", kTfType, test::transform(stamp, "base_link", "wheel", {0, 0, 9}));
  }
  const maps::Drive drive = open();
  ASSERT_EQ(drive.size(), 4U);
  EXPECT_NEAR((drive.T_map_lidar(2).translation() - Eigen::Vector3d(2, 5, 1)).norm(), 0, 1e-12);
  EXPECT_THAT(drive.contents().notes, ElementsAre("poses are those of tf from 'map' to 'lidar'"));
}

TEST_F(BagDrive, TakesTfFromTheMapAndNotFromWhatStandsAboveIt) {
  for (const std::string above : {"earth", "utm"}) {
    messages_.resize(4);
    add_static(above, "map", {4e6, 5e5, 4.9e6, 0, 1, 0, 0});
    for (int i = -1; i <= 4; ++i)
      add("/tf", kTfType,
          test::transform(kStart + i * kStep + kStep / 2, "map", "lidar", {i + 0.5, 0, 0}));
    EXPECT_NEAR(xs(open())[2], 2.0, 1e-12) << above;
    EXPECT_NEAR(xs(open("?poses=/tf"))[2], 2.0, 1e-12) << above;
  }
}

TEST_F(BagDrive, TakesTfFromTheEarthWhereThereIsNoMap) {
  for (int i = -1; i <= 4; ++i)
    add("/tf", kTfType,
        test::transform(kStart + i * kStep + kStep / 2, "earth", "lidar", {i + 0.5, 0, 0}));
  EXPECT_NEAR(xs(open())[2], 2.0, 1e-12);
}

TEST_F(BagDrive, ListsTfBesideATopicThatSaysSomethingElse) {
  const auto add_tf = [&](const std::string& parent, const std::string& child, double y) {
    for (int i = -1; i <= 4; ++i)
      add("/tf", kTfType,
          test::transform(kStart + i * kStep + kStep / 2, parent, child, {i + 0.5, y, 0}));
  };
  add_odometry("/odom", "base_link");
  add_static("base_link", "lidar", {});
  add_tf("odom", "base_link", 0.0);
  // The same twice.
  EXPECT_THAT(open().contents().notes, ElementsAre("poses are those of /odom"));
  // A map that stands still above it, and a frame beside the chain.
  add_static("map", "odom", {7, 0, 0});
  add_static("base_link", "base_footprint", {});
  EXPECT_NEAR(xs(open())[1], 1.0, 1e-12);
  std::erase_if(messages_, [](const Message& message) { return message.topic == "/odom"; });
  add_odometry("/odom", "base_footprint");
  EXPECT_THAT(open().contents().notes, Contains("poses are those of /odom"));
  std::erase_if(messages_, [](const Message& message) {
    return message.topic == "/odom" || message.topic == "/tf_static";
  });
  add_odometry("/odom", "base_link");
  add_static("base_link", "lidar", {});
  // Wheels, and what corrects them.
  add_tf("map", "odom", 5.0);
  expect_error(
      {"poses on /odom (6 nav_msgs/msg/Odometry), /tf (tf from 'map' to 'lidar')", "?poses=/odom"});
  EXPECT_NEAR(open("?poses=/tf").T_map_lidar(1).translation().y(), 5.0, 1e-12);
  EXPECT_NEAR(open("?poses=/odom").T_map_lidar(1).translation().y(), 0.0, 1e-12);
  EXPECT_NEAR(open("?pose_frame=base_link").T_map_lidar(1).translation().y(), 0.0, 1e-12);
}

/// A drive around a bend whose odometry starts at 0 facing 30 degrees off the east, and an antenna
/// beside the lidar.
class BagDriveWithGnss : public BagDrive {
 protected:
  static constexpr int kScans = 60;
  BagDriveWithGnss() {
    messages_.clear();
    for (int i = 0; i < kScans; ++i) clouds("/points", i);
    add_static("base_link", "lidar", {0, 0, 2});
    for (int i = 0; i <= 2 * kScans; ++i) {
      const double yaw = heading(0.5 * i);
      const Eigen::Vector3d p = position(0.5 * i);
      add("/odom", kOdometryType,
          odometry(kStart + i * kStep / 2,
                   {p.x(), p.y(), p.z(), 0, 0, std::sin(yaw / 2), std::cos(yaw / 2)}, "base_link"));
    }
  }
  void add_fixes(int first = 0) {
    for (int i = first; i < 2 * kScans; ++i) {
      const double at = 0.5 * i + 0.2;
      const Eigen::Vector3d p_odom_antenna =
          position(at) + Eigen::AngleAxisd(heading(at), Eigen::Vector3d::UnitZ()) * antenna_;
      const Eigen::Vector3d p_utm = utm_.to_utm(T_enu_odom() * p_odom_antenna);
      const maps::GeodeticOrigin place = geodetic_of(p_utm, utm_.zone());
      add("/fix", kFixType,
          test::nav_sat_fix(kStart + i * kStep / 2 + kStep / 5, place.latitude_deg,
                            place.longitude_deg, place.altitude_m));
    }
  }
  /// Of base_link in odom, 40 m a scan around a circle of 500 m.
  static double heading(double scan) { return 40.0 * scan / 500.0; }
  static Eigen::Vector3d position(double scan) {
    return 500.0 * Eigen::Vector3d(std::sin(heading(scan)), 1.0 - std::cos(heading(scan)), 0.0);
  }
  static Eigen::Isometry3d T_enu_odom() {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.linear() =
        Eigen::AngleAxisd(std::numbers::pi / 6, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    T.translation() = Eigen::Vector3d(3.0, 4.0, 0.0);
    return T;
  }

  static constexpr maps::GeodeticOrigin kPlace{-33.9, 18.4, 60.0};
  maps::UtmProjection utm_{kPlace, utm_zone_of(kPlace).value()};
  Eigen::Vector3d antenna_{-1.0, 0.5, 1.5};
};

TEST_F(BagDriveWithGnss, TurnsTheMapToEastAndNorthWhereFixesAreChosen) {
  add_static("base_link", "gps", {-1.0, 0.5, 1.5});
  add("/fix", kFixType, test::nav_sat_fix(kStart, 0.0, 0.0, 0.0, "gps", -1));
  add("/fix", kFixType, test::nav_sat_fix(kStart, -33.9, 18.4, std::nan("")));
  add_fixes();
  for (const std::string words : {"?gnss=/fix", "?gnss=/fix&poses=/odom"}) {
    const maps::Drive drive = open(words);
    ASSERT_TRUE(drive.contents().origin);
    const Eigen::Isometry3d T_enu_map = T_enu_enu(kPlace, *drive.contents().origin);
    for (const std::size_t i : {0U, 17U, 59U}) {
      const double scan = static_cast<double>(i);
      const Eigen::Vector3d p_enu =
          T_enu_odom() * (position(scan) + Eigen::Vector3d(0.0, 0.0, 2.0));
      // Chords between the poses, and the Earth's curve.
      EXPECT_NEAR((T_enu_map * drive.T_map_lidar(i).translation() - p_enu).norm(), 0.0, 0.3) << i;
      const Eigen::Vector3d ahead = T_enu_map.linear() * drive.T_map_lidar(i).linear().col(0);
      EXPECT_NEAR(
          std::remainder(std::atan2(ahead.y(), ahead.x()) - heading(scan) - std::numbers::pi / 6,
                         2 * std::numbers::pi),
          0.0, 1e-3)
          << i;
    }
    EXPECT_THAT(drive.contents().notes, AllOf(Contains(HasSubstr("turned by 30.0")),
                                              Contains(HasSubstr("2 messages of /fix left out"))));
  }
}

TEST_F(BagDriveWithGnss, ReadsALogOfNmeaBesideTheBag) {
  antenna_ = {0.0, 0.0, 2.0};  // at the lidar
  add_fixes();
  const maps::Drive by_topic = open("?gnss=/fix");
  std::string nmea;
  for (int i = 0; i < 2 * kScans; ++i) {
    const double at = 0.5 * i + 0.2;
    const Eigen::Vector3d p_odom_antenna =
        position(at) + Eigen::AngleAxisd(heading(at), Eigen::Vector3d::UnitZ()) * antenna_;
    const maps::GeodeticOrigin place =
        geodetic_of(utm_.to_utm(T_enu_odom() * p_odom_antenna), utm_.zone());
    // 1,700,000,000 s after 1970 it was 22:13:20.
    const double seconds = 20.0 + 0.05 * i + 0.02;
    const auto angle = [](double degrees) {
      const double whole = std::floor(std::abs(degrees));
      return fmt::format("{:.9f}", 100.0 * whole + 60.0 * (std::abs(degrees) - whole));
    };
    nmea +=
        fmt::format("$GNGGA,2213{:06.3f},{},S,{},E,4,12,0.8,{:.4f},M,30.0,M,,\n", seconds,
                    angle(place.latitude_deg), angle(place.longitude_deg), place.altitude_m - 30.0);
  }
  folder_.write("track.nmea", nmea);
  const maps::Drive by_log = open("?gnss=track.nmea");
  ASSERT_TRUE(by_log.contents().origin);
  EXPECT_LT(T_enu_enu(*by_topic.contents().origin, *by_log.contents().origin).translation().norm(),
            0.01);
  EXPECT_LT((by_log.T_map_lidar(30).translation() - by_topic.T_map_lidar(30).translation()).norm(),
            0.01);
  EXPECT_THAT(by_log.contents().notes, Contains(HasSubstr("track.nmea tells no date")));
  EXPECT_THAT(by_log.contents().notes,
              Contains(HasSubstr("track.nmea does not say where its antenna stands")));
  // A frame of another device's has nothing to do with it.
  add_static("base_link", "antenna", {30.0, 0.0, 2.0});
  EXPECT_LT((open("?gnss=track.nmea").T_map_lidar(30).translation() -
             by_log.T_map_lidar(30).translation())
                .norm(),
            1e-6);
  // Nothing but what lies beside it.
  expect_error({"no GNSS on ../track.nmea"}, "?gnss=../track.nmea");
  expect_error({"no GNSS on none.nmea", "NMEA log beside the bag"}, "?gnss=none.nmea");
}

TEST_F(BagDriveWithGnss, LeavesTheMapWhereItIsWithoutAChoice) {
  add_fixes();
  const maps::Drive drive = open();
  EXPECT_FALSE(drive.contents().origin);
  EXPECT_NEAR(drive.T_map_lidar(0).translation().head<2>().norm(), 0.0, 1e-9);
  EXPECT_THAT(drive.contents().notes, Contains(HasSubstr("GNSS on /fix: not taken")));
  EXPECT_THAT(open("?gnss=/fix").contents().notes,
              Contains(HasSubstr("no place of 'gps' of /fix: taken as that of the lidar")));
}

TEST_F(BagDriveWithGnss, RefusesFixesThatPlaceNothing) {
  expect_error({"no GNSS on /fix; there is none", "NavSatFix"}, "?gnss=/fix");
  add_fixes(2 * kScans - 10);
  expect_error({"no GNSS on /odom; there is /fix"}, "?gnss=/odom");
  expect_error({"gnss without poses"}, "?gnss=/fix&poses=none");
  // Behind the last scan there is no pose.
  expect_error({"run.mcap /fix: found", "fixes beside the poses", "at least 10"}, "?gnss=/fix");
}

TEST_F(BagDrive, TakesNoGoalsForAPath) {
  for (int i = 4; i < 100; ++i) clouds("/points", i);
  for (const int i : {0, 90})
    add("/goal_pose", kPoseType, test::pose_stamped(kStart + i * kStep, {1.0 * i}));
  const maps::Drive drive = open();
  EXPECT_FALSE(drive.has_poses());
  EXPECT_THAT(
      drive.contents().notes,
      ElementsAre(HasSubstr("/goal_pose is not used for poses: it has only 2 for 100 scans")));
  EXPECT_TRUE(open("?poses=/goal_pose").has_poses());
  EXPECT_TRUE(open("?pose_frame=lidar").has_poses());
  // Many of them are listed beside tf.
  for (const int i : {10, 20})
    add("/goal_pose", kPoseType, test::pose_stamped(kStart + i * kStep, {}));
  for (int i = 0; i < 100; ++i)
    add("/tf", kTfType, test::transform(kStart + i * kStep, "map", "lidar", {1.0 * i, 0, 0}));
  expect_error({"/goal_pose (4 geometry_msgs/msg/PoseStamped), /tf (tf from 'map' to 'lidar')"});
}

TEST_F(BagDrive, RefusesATopicOfTwoTypesOnlyWhereOneIsRead) {
  add_odometry();
  const std::filesystem::path root = folder_.path() / "run";
  std::filesystem::create_directories(root);
  const auto with = [&](const std::string& topic, const std::string& type) {
    std::vector<Message> messages = messages_;
    messages.push_back({topic, type, "anything"});
    return messages;
  };
  write_sqlite(root / "a.db3", with("/status", "a/msg/A"));
  write_sqlite(root / "b.db3", {{"/status", "b/msg/B", "anything"}});
  EXPECT_EQ(maps::Drive::open(root).size(), 4U);
  std::filesystem::remove(root / "b.db3");
  write_sqlite(root / "b.db3", {{"/odom", "b/msg/B", "anything"}});
  EXPECT_THAT([&] { (void)maps::Drive::open(root); },
              ThrowsSaying<maps::InputError>({"topic /odom of nav_msgs/msg/Odometry and b/msg/B"}));
}

TEST_F(BagDrive, TakesNoTfFromAFrameThatMayMove) {
  for (int i = -1; i <= 4; ++i)
    add("/tf", kTfType,
        test::transform(kStart + i * kStep + kStep / 2, "base_link", "lidar", {0.1 * i, 0, 1}));
  const maps::Drive drive = open();
  EXPECT_FALSE(drive.has_poses());
  EXPECT_THAT(drive.contents().notes, ElementsAre(HasSubstr("'lidar' in 'base_link'")));
  EXPECT_TRUE(open("?poses=/tf").has_poses());
}

TEST_F(BagDrive, TakesAMountThatTfRepeats) {
  for (int i = -1; i <= 4; ++i) {
    const std::int64_t stamp = kStart + i * kStep + kStep / 2;
    add("/tf", kTfType, test::transform(stamp, "base_link", "lidar", {0, 0, 1}));
    add("/odom", kOdometryType, odometry(stamp, {i + 0.5, 0, 0}, "base_link"));
  }
  const maps::Drive drive = open();
  ASSERT_EQ(drive.size(), 4U);
  EXPECT_NEAR((drive.T_map_lidar(2).translation() - Eigen::Vector3d(2, 0, 1)).norm(), 0, 1e-12);
  EXPECT_THAT(drive.contents().notes,
              Contains(HasSubstr("'lidar' in 'base_link' without a change")));
}

TEST_F(BagDrive, RefusesChainsOfTfThatNoRobotHas) {
  const auto chain = [&](int from, int to) {
    for (int i = from; i < to; ++i)
      add_static("f" + std::to_string(i + 1), i == 0 ? "lidar" : "f" + std::to_string(i), {});
  };
  chain(0, 64);
  EXPECT_FALSE(open().has_poses());
  chain(64, 65);
  expect_error({"65 frames above 'lidar' in tf", "at most 64"});
}

TEST_F(BagDrive, ReadsASplitBagOfSqliteInTheOrderOfItsMetadata) {
  const std::filesystem::path root = folder_.path() / "run";
  std::filesystem::create_directories(root);
  add_odometry();
  write_sqlite(root / "b.db3", {messages_.begin(), messages_.begin() + 2});
  write_sqlite(root / "a.db3", {messages_.begin() + 2, messages_.end()});
  folder_.write("run/metadata.yaml",
                "rosbag2_bagfile_information:\n  version: 4\n  relative_file_paths:\n    - b.db3\n"
                "    - run/a.db3\n  message_count: 10\n");
  const maps::Drive drive = maps::Drive::open(root);
  EXPECT_EQ(drive.contents().layout, maps::DriveLayout::kRosbag2);
  ASSERT_EQ(drive.size(), 4U);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(drive.read(i).cloud.positions[0].x(), static_cast<float>(i + 1));
    EXPECT_NEAR(xs(drive)[i], static_cast<double>(i), 1e-12);
  }
  std::filesystem::remove(root / "b.db3");
  EXPECT_THAT([&] { (void)maps::Drive::open(root); },
              ThrowsSaying<maps::InputError>({"metadata.yaml", "'b.db3', which is not there"}));
  folder_.write("run/metadata.yaml", "relative_file_paths:\n  - " + std::string(300, 'b') + "\n");
  EXPECT_THAT([&] { (void)maps::Drive::open(root); },
              ThrowsSaying<maps::InputError>({"metadata.yaml", "bbb', which is not there"}));
  std::filesystem::remove(root / "metadata.yaml");
  EXPECT_EQ(maps::Drive::open(root).size(), 2U);
  folder_.write("run/c.mcap", mcap_of(messages_));
  EXPECT_THAT([&] { (void)maps::Drive::open(root); },
              ThrowsSaying<maps::InputError>({"c.mcap and a.db3"}));
}

TEST_F(BagDrive, UnpacksABagThatIsPackedAsAWhole) {
  const std::filesystem::path root = folder_.path() / "run";
  add_odometry();
  std::filesystem::create_directories(root);
  write_sqlite(root / "run_0.db3", messages_);
  const std::string sqlite = bytes_of(root / "run_0.db3");
  std::filesystem::remove(root / "run_0.db3");
  folder_.write("run/run_0.db3.zstd", test::packed(sqlite, "zstd"));
  const auto expect_read = [&](const std::filesystem::path& place, maps::DriveLayout layout) {
    const maps::Drive drive = maps::Drive::open(place);
    EXPECT_EQ(drive.contents().layout, layout);
    ASSERT_EQ(drive.size(), 4U);
    for (std::size_t i = 0; i < 4; ++i)
      EXPECT_EQ(drive.read(i).cloud.positions[0].x(), static_cast<float>(i + 1));
    EXPECT_THAT(drive.contents().notes, Contains(HasSubstr("is packed as a whole: unpacked to")));
    EXPECT_THAT(drive.read(1).source, HasSubstr(".zst"));
    // Nothing stays, nor lies there while it is read.
    EXPECT_EQ(std::distance(std::filesystem::directory_iterator(place.parent_path()), {}), 1);
  };
  expect_read(root / "run_0.db3.zstd", maps::DriveLayout::kRosbag2);
  EXPECT_EQ(maps::Drive::open(root).size(), 4U);
  folder_.write("run/metadata.yaml", "  relative_file_paths:\n    - run_0.db3.zstd\n");
  EXPECT_EQ(maps::Drive::open(root).size(), 4U);
  expect_read(folder_.write("mcap/a.mcap.zst", test::packed(mcap_of(messages_), "zstd")),
              maps::DriveLayout::kMcap);
  // Unpacked by hand.
  std::filesystem::remove(root / "run_0.db3.zstd");
  write_sqlite(root / "run_0.db3", messages_);
  EXPECT_EQ(maps::Drive::open(root).size(), 4U);
}

TEST_F(BagDrive, UnpacksNoMoreThanABagHolds) {
  const auto expect_refused = [&](const std::string& name, const std::string& bytes,
                                  const std::vector<std::string>& texts) {
    const auto file = folder_.write(name, bytes);
    EXPECT_THAT([&] { (void)maps::Drive::open(file); }, ThrowsSaying<maps::InputError>(texts))
        << name;
    EXPECT_EQ(std::distance(std::filesystem::directory_iterator(file.parent_path()), {}), 1);
  };
  expect_refused("zeros/a.db3.zstd", test::packed(std::string(64U << 20U, '\0'), "zstd"),
                 {"a.db3.zstd", "unpacked bytes", "100 times"});
  std::string broken = test::packed(mcap_of(messages_), "zstd");
  broken[broken.size() / 2] ^= 0x55;
  expect_refused("broken/a.mcap.zstd", broken.substr(0, broken.size() / 2 + 1) + "rubbish rubbish",
                 {"a.mcap.zstd"});
  expect_refused("other/a.db3.zstd", test::packed("no bag", "zstd"), {"a.db3.zstd", "no bag"});
}

TEST_F(BagDrive, TakesNoPartOfABagForTheWhole) {
  folder_.write("run/a.mcap", mcap_of(messages_));
  folder_.write("run/b.mcap.zstd", test::packed(mcap_of(messages_), "zstd"));
  EXPECT_THAT(
      [&] { (void)maps::Drive::open(folder_.path() / "run"); },
      ThrowsSaying<maps::InputError>({"a.mcap and b.mcap.zstd", "all of them packed or none"}));
}

TEST_F(BagDrive, HearsTheFolderAndWordsBeforeIt) {
  clouds("/rear", 9);
  folder_.write("run/run.mcap", mcap_of(messages_));
  folder_.write("run/topics.txt", "cloud=/rear\nposes=none\n");
  const std::string root = (folder_.path() / "run").string();
  EXPECT_EQ(maps::Drive::open(root).size(), 1U);
  EXPECT_EQ(maps::Drive::open(root + "?cloud=/points").size(), 4U);
}

TEST_F(BagDrive, TakesGivenPosesInsteadOfItsOwn) {
  add_odometry();
  const auto file = folder_.write("run.mcap", mcap_of(messages_));
  const auto poses = folder_.write("poses.txt",
                                   "1 0 0 7 0 1 0 0 0 0 1 0\n1 0 0 8 0 1 0 0 0 0 1 0\n"
                                   "1 0 0 9 0 1 0 0 0 0 1 0\n1 0 0 6 0 1 0 0 0 0 1 0\n");
  EXPECT_THAT(xs(maps::Drive::open(file, poses)), ElementsAre(7.0, 8.0, 9.0, 6.0));
}

TEST_F(BagDrive, ShiftsPosesInTime) {
  add_odometry();
  const auto file = folder_.write("run.mcap", mcap_of(messages_));
  EXPECT_THAT(xs(maps::Drive::open(file, std::nullopt, kStep / 2)),
              ElementsAre(DoubleNear(-0.5, 1e-6), DoubleNear(0.5, 1e-6), DoubleNear(1.5, 1e-6),
                          DoubleNear(2.5, 1e-6)));
  const auto poses = folder_.write("poses.txt",
                                   "1 0 0 7 0 1 0 0 0 0 1 0\n1 0 0 8 0 1 0 0 0 0 1 0\n"
                                   "1 0 0 9 0 1 0 0 0 0 1 0\n1 0 0 6 0 1 0 0 0 0 1 0\n");
  EXPECT_FALSE(maps::Drive::open(file).contents().path) << "its scans' poses tell the motion";
  EXPECT_THAT(xs(maps::Drive::open(file, poses, kStep)),
              ElementsAre(DoubleNear(6.0, 1e-6), DoubleNear(7.0, 1e-6), DoubleNear(8.0, 1e-6),
                          DoubleNear(9.0, 1e-6)));
}

TEST_F(BagDrive, LeavesOutScansThatGoBackInTime) {
  for (int i = 4; i < 12; ++i) clouds("/points", i);
  clouds("/points", 3);
  const maps::Drive drive = open();
  EXPECT_EQ(drive.size(), 12U);
  EXPECT_THAT(drive.contents().notes, ElementsAre(HasSubstr("run.mcap /points 12")));
}

TEST_F(BagDrive, LeavesOutTheOneStampThatIsFarOff) {
  for (int i = 4; i < 38; ++i) clouds("/points", i == 6 ? 36'000 : i);
  const maps::Drive drive = open();
  EXPECT_EQ(drive.size(), 37U);
  EXPECT_THAT(drive.contents().notes, ElementsAre(HasSubstr("run.mcap /points 6")));
  EXPECT_EQ(drive.stamp_ns(36), kStart + 37 * kStep);
  // Of two that are equal, the first.
  clouds("/points", 37);
  EXPECT_THAT(open().contents().notes, ElementsAre(HasSubstr("/points 6 run.mcap /points 38")));
}

TEST_F(BagDrive, KeepsTheScansOfOneClock) {
  messages_.clear();
  // A driver that has no time yet, and a clock that is set.
  add("/points", kCloudType, one_point(0, 1));
  for (int i = 0; i < 4; ++i) clouds("/points", i);
  for (int i = 0; i < 3; ++i) add("/points", kCloudType, one_point(12'000'000'000 + i, 1));
  const maps::Drive drive = open();
  EXPECT_EQ(drive.size(), 4U);
  EXPECT_FALSE(drive.relative_clock());
  EXPECT_EQ(drive.stamp_ns(0), kStart);
  EXPECT_THAT(drive.contents().notes,
              ElementsAre(testing::AllOf(
                  HasSubstr("4 scans left out, whose stamps are of another clock"),
                  HasSubstr("/points 0 at 0.000 s"), HasSubstr("?stamps=recorded'"))));
}

TEST_F(BagDrive, OffersAndTakesTheRecordersTimesOfScans) {
  messages_.clear();
  for (int i = 0; i < 4; ++i) add("/points", kCloudType, one_point(0, static_cast<float>(i + 1)));
  add_odometry();
  expect_error(
      {"the stamp 0.000 s for all 4 scans", "add stamps=recorded", "run.mcap?stamps=recorded'"});
  const maps::Drive drive = open("?stamps=recorded");
  EXPECT_THAT(drive.contents().stamps_ns,
              ElementsAre(kStart, kStart + kStep, kStart + 2 * kStep, kStart + 3 * kStep));
  EXPECT_TRUE(drive.has_poses());
  EXPECT_THAT(drive.contents().notes, Contains(HasSubstr("when the recorder got the clouds")));
  expect_error({"'stamps=none'", "stamps=header or stamps=recorded"}, "?stamps=none");
}

TEST_F(BagDrive, NamesBothClocksWhereNoPoseIsNearAScan) {
  messages_.clear();
  for (int i = 0; i < 4; ++i) add("/points", kCloudType, one_point(543'000'000'000 + i * kStep, 1));
  add_odometry();
  expect_error(
      {"the poses are from 1699999999.950 s to 1700000000.450 s, the scans from 543.000 s to "
       "543.300 s",
       "?stamps=recorded'"});
  EXPECT_TRUE(open("?stamps=recorded").has_poses());
}

/// sensor_msgs/Imu at rest.
std::string imu_message(std::int64_t stamp_ns) {
  test::MessageBytes message;
  message.header(stamp_ns, "lidar");
  for (int i = 0; i < 4 + 9 + 3 + 9; ++i) message.put(0.0);
  for (const double force : {0.0, 0.0, 9.81}) message.put(force);
  for (int i = 0; i < 9; ++i) message.put(0.0);
  return message.str();
}

TEST_F(BagDrive, TakesTheImuToTheRecordersClockWithItsClouds) {
  constexpr std::int64_t kSwitchedOn = 543'000'000'000;
  const char* const imu_type = "sensor_msgs/msg/Imu";
  messages_.clear();
  for (int i = 0; i < 4; ++i) {
    add("/points", kCloudType, one_point(kSwitchedOn + i * kStep, 1));
    add("/imu", imu_type, imu_message(kSwitchedOn + i * kStep));
  }
  const auto readings = [&](const std::string& words) {
    return *open(words).contents().imu->readings;
  };
  EXPECT_EQ(readings("").front().stamp_ns, kSwitchedOn);
  // The recorder gets a message each step, one of two of the IMU's.
  ASSERT_EQ(readings("?stamps=recorded").size(), 4U);
  EXPECT_EQ(readings("?stamps=recorded").front().stamp_ns, kStart + 3 * kStep);
  EXPECT_EQ(readings("?stamps=recorded").back().stamp_ns, kStart + 6 * kStep);
  for (int i = 0; i < 2; ++i) add("/late_imu", imu_type, imu_message(kSwitchedOn + i * kStep));
  EXPECT_EQ(readings("?imu=/late_imu").size(), 2U);
  EXPECT_FALSE(open().contents().imu);
  EXPECT_FALSE(open("?imu=none").contents().imu);
}

TEST_F(BagDrive, TakesACalibrationOnlyFromItsOwnFolder) {
  folder_.write("outside.yaml", "- laser_id: 0\n");
  folder_.write("bag/run.mcap", mcap_of(messages_));
  folder_.write("bag/front.yaml", "- laser_id: 0\n");
  const std::string bag = (folder_.path() / "bag").string();
  for (const std::string& name : {(folder_.path() / "outside.yaml").string(),
                                  std::string("../outside.yaml"), std::string("none.yaml")}) {
    const auto refused =
        ThrowsSaying<maps::InputError>({"no calibration '" + name, "beside the bag"});
    EXPECT_THAT([&] { (void)maps::Drive::open(bag + "?calibration=" + name); }, refused);
    EXPECT_THAT([&] { (void)maps::Drive::open(bag + "/run.mcap?calibration=" + name); }, refused);
    // As an upload may say it.
    folder_.write("bag/topics.txt", "calibration=" + name + "\n");
    EXPECT_THAT([&] { (void)maps::Drive::open(bag); }, refused);
  }
  // It is found, but clouds have no use for it.
  folder_.write("bag/topics.txt", "calibration=front.yaml\n");
  const auto unused = ThrowsSaying<maps::InputError>(
      {"calibration= for clouds on /points of sensor_msgs/msg/PointCloud2", "leave out"});
  EXPECT_THAT([&] { (void)maps::Drive::open(bag); }, unused);
  EXPECT_THAT([&] { (void)maps::Drive::open(bag + "/run.mcap?calibration=front.yaml"); }, unused);
}

TEST_F(BagDrive, KeepsAChoiceThatIsWrongWithOneTopicOfClouds) {
  EXPECT_EQ(open("?cloud=/points").size(), 4U);
  for (const char* words :
       {"?cloud=/point", "?poses=/odom", "?imu=/nope", "?gnss=/fix", "?calibration=none.yaml",
        "?cloud=/points,/points", "?cloud=/points,"}) {
    const auto opened = [&] { (void)open(words); };
    EXPECT_THAT(opened, ::testing::Throws<maps::ChoiceError>()) << words;
  }
}

/// Of one point.
std::string livox_cloud(int i, std::uint8_t lidar) {
  test::MessageBytes cloud;
  cloud.header(kStart + i * kStep, "livox").put(static_cast<std::uint64_t>(kStart + i * kStep));
  cloud.put(std::uint32_t{1}).put(lidar);
  for (int reserve = 0; reserve < 3; ++reserve) cloud.put(std::uint8_t{0});
  cloud.put(std::uint32_t{1}).put(std::uint32_t{20'000'000});
  cloud.put(static_cast<float>(i + 1)).put(0.0F).put(0.0F);
  cloud.put(std::uint8_t{9}).put(std::uint8_t{0}).put(std::uint8_t{3});
  return cloud.str();
}

TEST_F(BagDrive, RefusesCloudsOfSeveralLivoxOnOneTopic) {
  messages_.clear();
  for (int i = 0; i < 4; ++i)
    add("/livox/lidar", "livox_ros_driver/msg/CustomMsg",
        livox_cloud(i, static_cast<std::uint8_t>(i % 2)));
  expect_error({"clouds of lidars 0, 1 on /livox/lidar", "one lidar", "multi_topic 1"});
}

TEST_F(BagDrive, ReadsCloudsOfLivox) {
  messages_.clear();
  for (int i = 0; i < 2; ++i)
    add("/livox/lidar", "livox_ros_driver2/msg/CustomMsg", livox_cloud(i, 3));
  const maps::Drive drive = open();
  EXPECT_EQ(drive.contents().entries.fields.front(), "offset_time u32");
  EXPECT_THAT(drive.read(1).cloud.positions, ElementsAre(Eigen::Vector3f(2, 0, 0)));
  EXPECT_THAT(drive.read(1).cloud.time_offsets_s, ElementsAre(testing::FloatEq(0.02F)));
}

/// `PacketMsg` of an Ouster of one pixel and one column a packet, whose range is 1 m a packet.
class OusterBag : public BagDrive {
 protected:
  static constexpr const char* kTopic = "/ouster/lidar_packets";
  static constexpr const char* kMetadata =
      R"({"beam_altitude_angles": [0], "beam_azimuth_angles": [0], "prod_line": "OS-1-1",
          "lidar_to_sensor_transform": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
          "lidar_data_format": {"columns_per_frame": 4, "columns_per_packet": 1,
          "pixels_per_column": 1, "udp_profile_lidar": "RNG15_RFL8_NIR8"}})";

  OusterBag() { messages_.clear(); }
  /// @param column  0 to 3, a quarter turn and 25 ms apart.
  void packet(int turn, int column) {
    std::string bytes(32 + 12 + 4 + 32, '\0');
    const auto put = [&](std::size_t at, auto value) {
      std::memcpy(&bytes[at], &value, sizeof value);
    };
    put(0, std::uint16_t{1});
    put(2, static_cast<std::uint16_t>(turn));
    put(32, kStart + turn * kStep + column * kStep / 4);
    put(40, static_cast<std::uint16_t>(column));
    put(42, std::uint16_t{1});
    put(44, static_cast<std::uint16_t>(125 * (column + 1)));
    add(kTopic, "ouster_sensor_msgs/msg/PacketMsg", test::MessageBytes().bytes(bytes).str());
  }
  void metadata() {
    add("/ouster/metadata", "std_msgs/msg/String", test::MessageBytes().text(kMetadata).str());
  }
};

TEST_F(OusterBag, PacketsBecomeAScanATurn) {
  for (const int column : {2, 3}) packet(0, column);
  metadata();
  // What the IMU sends on a topic of the same type.
  add("/ouster/imu_packets", "ouster_sensor_msgs/msg/PacketMsg",
      test::MessageBytes().bytes(std::string(48, '\1')).str());
  for (const int turn : {1, 2})
    for (const int column : {0, 1, 2, 3}) packet(turn, column);
  packet(1, 3);  // late
  packet(3, 0);
  const maps::Drive drive = open();
  EXPECT_THAT(drive.contents().stamps_ns, ElementsAre(kStart + kStep / 2, kStart + kStep,
                                                      kStart + 2 * kStep, kStart + 3 * kStep));
  EXPECT_EQ(drive.contents().entries.frame_id, "os_sensor");
  EXPECT_THAT(drive.contents().notes,
              Contains(HasSubstr("1 messages of /ouster/lidar_packets cannot be read, the first: "
                                 "/ouster/lidar_packets: found a packet of turn 1 after")));
  const maps::PointCloud turn = drive.read(1).cloud;
  // Column by column, clockwise from x.
  ASSERT_EQ(turn.size(), 4U);
  EXPECT_LT((turn.positions[0] - Eigen::Vector3f(1.0F, 0.0F, 0.0F)).norm(), 1e-5F);
  EXPECT_LT((turn.positions[1] - Eigen::Vector3f(0.0F, -2.0F, 0.0F)).norm(), 1e-5F);
  EXPECT_THAT(turn.time_offsets_s, ElementsAre(0.0F, 0.025F, 0.05F, 0.075F));
  EXPECT_EQ(drive.read(0).cloud.size(), 2U);
}

TEST_F(OusterBag, MetadataMayLieBesideTheBag) {
  for (const int column : {0, 1}) packet(0, column);
  expect_error(
      {"packets of an Ouster on /ouster/lidar_packets, without metadata on /ouster/metadata",
       "calibration=NAME"});
  EXPECT_THROW((void)open(), maps::ChoiceError);
  // An upload is kept until the metadata is named, here of a file that came with it.
  folder_.write("os.json", kMetadata);
  EXPECT_TRUE(open_drive_folder(folder_.path(), "").needs_choice);
  EXPECT_FALSE(open_drive_folder(folder_.path(), "calibration=os.json").needs_choice);
  EXPECT_EQ(open("?calibration=os.json").read(0).cloud.size(), 2U);
  folder_.write("os.json", "{}");
  expect_error({"os.json", "beam_altitude_angles"}, "?calibration=os.json");
  folder_.write("os.json",
                std::string(kMetadata).replace(std::string(kMetadata).find(": 1,"), 4, ": 2,"));
  EXPECT_THAT([&] { (void)open("?calibration=os.json").read(0); },
              ThrowsSaying<maps::InputError>({kTopic, "a packet of 80 bytes", "metadata"}));
}

TEST_F(BagDrive, SaysFrameAndColumnsOfItsClouds) {
  EXPECT_EQ(open().contents().entries.frame_id, "lidar");
  EXPECT_THAT(open().contents().entries.fields, ElementsAre("x f32", "y f32", "z f32"));
}

TEST_F(BagDrive, ChecksSeeWhatIsWrongWithARecording) {
  const auto codes = [&] {
    std::vector<std::string> found;
    for (const maps::DriveFinding& finding : check_drive(open()).findings)
      found.push_back(finding.code);
    return found;
  };
  EXPECT_THAT(codes(), ElementsAre("no_poses"));
  // A driver that is stuck sends the same points with new stamps.
  for (int i = 4; i < 9; ++i)
    add("/points", kCloudType, one_point(kStart + i * kStep, 7.0F, "lidar"));
  EXPECT_THAT(codes(), Contains("duplicates"));
  EXPECT_THAT(codes(), Not(Contains("gaps")));
  // However many there are.
  for (const int i : {15, 21, 27}) clouds("/points", i);
  EXPECT_THAT(codes(), Contains("gaps"));
}

TEST_F(BagDrive, ChecksSayWhyTimesAreNotTaken) {
  messages_.clear();
  test::CloudMessage cloud;
  cloud.fields.push_back({"timestamp", 12, 8, 1});
  cloud.point_step = 20;
  for (int i = 0; i < 3; ++i) {
    cloud.stamp_ns = kStart + i * kStep;
    cloud.data.assign(20, '\0');
    const float x = static_cast<float>(i + 1);
    std::memcpy(cloud.data.data(), &x, sizeof x);
    // GPS time, 18 s and a week's number beside Unix.
    const double time_s = 1.4e9 + i;
    std::memcpy(&cloud.data[12], &time_s, sizeof time_s);
    add("/points", kCloudType, cloud.str());
  }
  const maps::DriveCheck check = check_drive(open());
  const auto found = std::find_if(check.findings.begin(), check.findings.end(),
                                  [](const auto& each) { return each.code == "times_not_taken"; });
  ASSERT_NE(found, check.findings.end());
  EXPECT_THAT(found->what, HasSubstr("the times of points in 'timestamp' are left out"));
}

TEST_F(BagDrive, ReadsWhatIsThereOfACutBag) {
  std::string whole = mcap_of(messages_);
  // The last cloud is followed by the 50 bytes of DataEnd, Footer and magic.
  const auto file = folder_.write("run.mcap", whole.substr(0, whole.size() - 60));
  const maps::Drive drive = maps::Drive::open(file);
  EXPECT_THAT(drive.contents().notes,
              ElementsAre(HasSubstr("cut off"), HasSubstr("1 parts of the bag")));
  EXPECT_EQ(drive.size(), 3U);
}

TEST_F(BagDrive, IsToldFromScansByItsFirstBytes) {
  const auto file = folder_.write("run.mcap", mcap_of(messages_));
  EXPECT_TRUE(maps::Drive::is_at(file));
  EXPECT_TRUE(maps::Drive::is_at(file.string() + "?cloud=/points"));
  EXPECT_TRUE(maps::Drive::is_at(folder_.path()));
  EXPECT_FALSE(maps::Drive::is_at(folder_.write("scan.bin", "0123")));
  EXPECT_FALSE(maps::Drive::is_at(folder_.path() / "nothing"));
  folder_.write("plain/a.bin", "");
  EXPECT_THAT([&] { (void)maps::Drive::open(folder_.path() / "plain?cloud=/a"); },
              ThrowsSaying<maps::InputError>({"'?cloud=/a'", "no bag"}));
}

/// A landmark 8 m ahead of the first scan, seen while the sensor moves towards it by 1 m a scan.
class RegisteredClouds : public BagDrive {
 protected:
  RegisteredClouds() { messages_.clear(); }
  /// @param is_registered  whether the points lie in the frame of the map.
  void add_clouds(const std::string& frame, bool is_registered = true) {
    for (int i = 0; i < 5; ++i)
      add("/points", kCloudType,
          one_point(kStart + i * kStep, static_cast<float>(is_registered ? 8 : 8 - i), frame));
  }
  void add_path(const std::string& topic, const std::string& parent, const std::string& child) {
    for (int i = 0; i < 5; ++i)
      add(topic, kOdometryType, odometry(kStart + i * kStep, {1.0 * i, 0, 0}, child, parent));
  }
  void add_tf(const std::string& parent, const std::string& child, double step_m = 1.0) {
    for (int i = 0; i < 5; ++i)
      add("/tf", kTfType, test::transform(kStart + i * kStep, parent, child, {step_m * i, 0, 0}));
  }
  void expect_points_of_the_sensor(const maps::Drive& drive, double path_m = 4.0) const {
    ASSERT_EQ(drive.size(), 5U);
    EXPECT_NEAR(drive.T_map_lidar(4).translation().x() - drive.T_map_lidar(0).translation().x(),
                path_m, 1e-9);
    for (std::size_t i = 0; i < 5; ++i)
      EXPECT_NEAR((drive.T_map_lidar(i) * drive.read(i).cloud.positions[0].cast<double>()).x(), 8.0,
                  1e-6);
    EXPECT_NEAR(drive.read(4).cloud.positions[0].x(), 8.0 - path_m, 1e-6);
  }
};

TEST_F(RegisteredClouds, InTheFrameOfThePosesAreBroughtBackToTheSensor) {
  add_clouds("camera_init");
  add_path("/Odometry", "camera_init", "body");
  add_tf("camera_init", "body");
  const maps::Drive drive = open();
  expect_points_of_the_sensor(drive);
  EXPECT_EQ(drive.contents().entries.frame_id, "body");
  EXPECT_TRUE(drive.contents().points_from_map);
  EXPECT_THAT(drive.contents().notes,
              Contains(::testing::AllOf(HasSubstr("clouds of /points name 'camera_init'"),
                                        HasSubstr("overlap by 100 % so, and by 0 %"))));
  // What was offered before does no harm.
  expect_points_of_the_sensor(open("?pose_frame=camera_init"));
  expect_points_of_the_sensor(open("?poses=/tf"));
  expect_error({"poses=none", "registered already", "/Odometry", "points=sensor"}, "?poses=none");
  EXPECT_FALSE(open("?poses=none&points=sensor").has_poses());
  EXPECT_EQ(open("?points=sensor").read(4).cloud.positions[0].x(), 8.0F);
}

TEST_F(RegisteredClouds, AreKnownByPosesThatNameNoFrameAndByTfAlone) {
  add_clouds("map");
  for (int i = 0; i < 5; ++i)
    add("/pose", kPoseType, test::pose_stamped(kStart + i * kStep, {1.0 * i, 0, 0}, "map"));
  expect_points_of_the_sensor(open());
  messages_.clear();
  add_clouds("world");
  add_tf("world", "velodyne");
  expect_points_of_the_sensor(open());
  // Any name of a frame, where the scans say so.
  messages_.clear();
  add_clouds("start");
  add_tf("start", "velodyne");
  expect_points_of_the_sensor(open());
}

TEST_F(RegisteredClouds, ThatAreJoinedToThePosesByTfAreBroughtBackByIt) {
  add_clouds("map");
  add_path("/odom", "odom", "base_link");
  add_tf("map", "odom", 0.5);
  add_tf("odom", "base_link");
  // 0.5 m and 1 m a scan.
  expect_points_of_the_sensor(open(), 6.0);
  messages_.clear();
  add_clouds("map");
  add_path("/odom", "odom", "base_link");
  add_static("map", "odom", {0, 0, 0});
  expect_points_of_the_sensor(open());
}

TEST_F(RegisteredClouds, AreToldFromCloudsThatOnlyNameAFixedFrame) {
  add_clouds("map", false);
  add_path("/odom", "map", "base_link");
  const maps::Drive drive = open();
  EXPECT_FALSE(drive.contents().points_from_map);
  EXPECT_EQ(drive.read(4).cloud.positions[0].x(), 4.0F);
  EXPECT_THAT(drive.contents().notes,
              Contains(HasSubstr("taken as points of the sensor (scans overlap by 0 % so, and by "
                                 "100 %")));
  EXPECT_EQ(open("?points=map").read(4).cloud.positions[0].x(), 0.0F);
}

TEST_F(RegisteredClouds, OfOtherFramesAreTakenAsChosen) {
  add_clouds("base_link");
  add_path("/odom", "odom", "base_link");
  const maps::Drive drive = open("?points=map");
  expect_points_of_the_sensor(drive);
  EXPECT_THAT(drive.contents().notes,
              Contains("points of /points are taken in the frame of the poses, as was chosen"));
}

TEST_F(RegisteredClouds, AreNotJoinedWithOthers) {
  add_clouds("odom");
  add_path("/odom", "odom", "base_link");
  for (int i = 0; i < 5; ++i) clouds("/rear", i, "odom");
  expect_error({"registered clouds on /points, one of several topics", "cloud=TOPIC"},
               "?cloud=/points,/rear&points=map");
  expect_error({"registered clouds on /points, one of several topics", "cloud=TOPIC"},
               "?cloud=/points,/rear");
}

TEST_F(RegisteredClouds, AreNotSeenInWhatMovesOnTheSensorItself) {
  add_clouds("base_link", false);
  add_tf("base_link", "wheel");
  const maps::Drive drive = open();
  EXPECT_FALSE(drive.has_poses());
  EXPECT_THAT(drive.contents().notes, Contains(HasSubstr("not registered by it")));
}

TEST_F(RegisteredClouds, HaveNoPosesWhereTfGoesInACircle) {
  add_clouds("odom", false);
  add_tf("odom", "odom");
  EXPECT_FALSE(open().has_poses());
  add_tf("map", "odom");
  add_tf("odom", "map");
  EXPECT_FALSE(open().has_poses());
}

TEST_F(RegisteredClouds, HaveNoMoreFramesBelowThemThanARobotHas) {
  add_clouds("map");
  add_path("/odom", "odom", "base_link");
  for (int i = 0; i < 65; ++i)
    add("/tf", kTfType,
        test::transform(kStart, i == 0 ? "map" : "f" + std::to_string(i),
                        i == 64 ? "base_link" : "f" + std::to_string(i + 1), {1.0, 0, 0}));
  expect_error({"65 frames above 'base_link' in tf", "at most 64"}, "?poses=/odom");
}

TEST_F(RegisteredClouds, MayBeChosenWithAFileOfPoses) {
  add_clouds("lidar");
  std::string tum;
  for (int i = 0; i < 5; ++i)
    tum += std::to_string(1'700'000'000 + i / 10) + "." + std::to_string(i) + " " +
           std::to_string(i) + " 0 0 0 0 0 1\n";
  const auto poses = folder_.write("poses.tum", tum);
  const auto file = folder_.write("run.mcap", mcap_of(messages_));
  expect_points_of_the_sensor(maps::Drive::open(file.string() + "?points=map", poses));
  EXPECT_THAT([&] { (void)maps::Drive::open(file.string() + "?points=map"); },
              ThrowsSaying<maps::InputError>({"no poses for points in the frame of a map"}));
  EXPECT_THAT([&] { (void)maps::Drive::open(file.string() + "?points=world", poses); },
              ThrowsSaying<maps::InputError>({"points=world", "points=map or points=sensor"}));
}

}  // namespace drive_bag_test
}  // namespace stillmap::server
