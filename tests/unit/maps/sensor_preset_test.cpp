#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/sensor_preset.hpp>

#include <cmath>
#include <cstdlib>
#include <numbers>

#include "sensors/turn_times.hpp"
#include "support/temporary_folder.hpp"

namespace stillmap::maps {
namespace sensor_preset_test {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::ThrowsMessage;

constexpr double kTurn = 2.0 * std::numbers::pi;

struct Turn {
  PointCloud cloud;
  std::vector<double> times_s;
};

/// Columns of lasers that look aside by up to 3 degrees, one column after the other; shots into a
/// third of the sky do not come back.
Turn one_turn(double direction, double start_rad, int lasers = 16, double low = -15.0,
              double high = 15.0, int columns = 1000) {
  Turn turn;
  for (int column = 0; column < columns; ++column) {
    for (int laser = 0; laser < lasers; ++laser) {
      const double share = static_cast<double>(column) / columns;
      const double aside = 0.05 * (laser % 4 - 1.5) / 1.5;
      const double azimuth = start_rad + direction * kTurn * share + aside;
      const double elevation =
          (low + (high - low) * laser / (lasers - 1)) * std::numbers::pi / 180.0;
      if (elevation > 0.1 && column % 3 == 0) continue;
      turn.cloud.positions.push_back(
          20.0F * Eigen::Vector3d(std::cos(elevation) * std::cos(azimuth),
                                  std::cos(elevation) * std::sin(azimuth), std::sin(elevation))
                      .cast<float>());
      turn.times_s.push_back(0.1 * share);
    }
  }
  return turn;
}

TEST(TurnTimes, FollowTheTurnEitherWayFromWhereverItStarts) {
  for (const double direction : {1.0, -1.0}) {
    for (const double start_rad : {0.0, 1.0, 3.1, -2.0}) {
      Turn turn = one_turn(direction, start_rad);
      set_turn_times(turn.cloud, 0.1, 0.0);
      ASSERT_EQ(turn.cloud.time_offsets_s.size(), turn.times_s.size());
      // Lasers look aside by up to 0.05 rad of the turn, and so does the first.
      for (std::size_t i = 0; i < turn.times_s.size(); ++i)
        ASSERT_NEAR(turn.cloud.time_offsets_s[i], turn.times_s[i], 0.1 * 0.11 / kTurn);
    }
  }
}

TEST(TurnTimes, CountFromWhereTheStampLies) {
  Turn turn = one_turn(-1.0, 0.5);
  set_turn_times(turn.cloud, 0.1, 1.0);
  EXPECT_NEAR(turn.cloud.time_offsets_s.front(), -0.1, 0.002);
  EXPECT_NEAR(turn.cloud.time_offsets_s.back(), 0.0, 0.002);
}

TEST(TurnTimes, AreNotGuessedWhereTheOrderIsAnother) {
  // Laser by laser, as in organized clouds and in KITTI's files.
  Turn turn = one_turn(-1.0, 0.5);
  std::vector<Eigen::Vector3f> by_laser;
  for (std::size_t laser = 0; laser < 4; ++laser)
    for (std::size_t i = laser; i < turn.cloud.size(); i += 4)
      by_laser.push_back(turn.cloud.positions[i]);
  turn.cloud.positions = by_laser;
  set_turn_times(turn.cloud, 0.1, 0.0);
  EXPECT_THAT(turn.cloud.time_offsets_s, IsEmpty());
  // Half a turn, the first point twice, none at all.
  PointCloud half = one_turn(1.0, 0.0).cloud;
  half.positions.resize(half.size() / 2);
  set_turn_times(half, 0.1, 0.0);
  EXPECT_THAT(half.time_offsets_s, IsEmpty());
  PointCloud same;
  same.positions = {Eigen::Vector3f::UnitX(), Eigen::Vector3f::UnitX()};
  set_turn_times(same, 0.1, 0.0);
  EXPECT_THAT(same.time_offsets_s, IsEmpty());
  PointCloud none;
  set_turn_times(none, 0.1, 0.0);
  EXPECT_THAT(none.time_offsets_s, IsEmpty());
}

class SensorDrive : public ::testing::Test {
 protected:
  SensorDrive() {
    std::string bytes;
    for (const Eigen::Vector3f& p : one_turn(-1.0, 0.5).cloud.positions)
      for (const float value : {p.x(), p.y(), p.z(), 1.0F})
        bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
    for (const char* name : {"1600000000.00.bin", "1600000000.05.bin", "1600000000.10.bin"})
      folder_.write(name, bytes);
  }
  test::TemporaryFolder folder_;
};

TEST_F(SensorDrive, OfAKnownSensorHasTimes) {
  const Drive drive = Drive::open(folder_.path());
  EXPECT_THAT(drive.read(1).cloud.time_offsets_s, IsEmpty());
  // Turns of 50 ms, the stamp at their end.
  const Drive turning = with_sensor(drive, sensor_preset("vlp-16"));
  const std::vector<float> times_s = turning.read(1).cloud.time_offsets_s;
  ASSERT_FALSE(times_s.empty());
  EXPECT_NEAR(times_s.front(), -0.05F, 0.001F);
  EXPECT_NEAR(times_s.back(), 0.0F, 0.001F);
  EXPECT_NEAR(with_sensor(drive, sensor_preset("os1-64")).read(1).cloud.time_offsets_s.front(),
              0.0F, 0.001F);
  EXPECT_THAT(with_sensor(drive, sensor_preset("avia")).read(1).cloud.time_offsets_s, IsEmpty());
}

TEST_F(SensorDrive, BroughtToOneInstantBeforeStaysSo) {
  std::filesystem::create_directories(folder_.path() / "sequence/velodyne");
  std::filesystem::copy(folder_.path() / "1600000000.00.bin",
                        folder_.path() / "sequence/velodyne/000000.bin");
  folder_.write("sequence/times.txt", "0\n");
  const Drive kitti = Drive::open(folder_.path() / "sequence");
  ASSERT_EQ(kitti.contents().layout, DriveLayout::kKittiOdometry);
  EXPECT_THAT(with_sensor(kitti, sensor_preset("hdl-64e")).read(0).cloud.time_offsets_s, IsEmpty());
}

TEST(SensorPresets, AreGuessedFromAnglesAndNumber) {
  Scan scan;
  scan.cloud = one_turn(-1.0, 0.0).cloud;
  EXPECT_THAT(guess_sensors(scan), ElementsAre("vlp-16", "xt32", "rs-16"));
  scan.cloud = one_turn(-1.0, 0.0, 128, -45.0, 45.0).cloud;
  EXPECT_THAT(guess_sensors(scan), ElementsAre("os0-64", "os0-128"));
  scan.cloud = one_turn(-1.0, 0.0, 40, -80.0, 80.0).cloud;
  EXPECT_THAT(guess_sensors(scan), IsEmpty());
  scan.cloud.positions.resize(10);
  EXPECT_THAT(guess_sensors(scan), IsEmpty());
}

TEST(SensorPresets, AreKnownByNameOrRefusedWithTheNames) {
  EXPECT_EQ(sensor_preset("mid-360").min_range_m, 0.5);
  EXPECT_THAT([] { (void)sensor_preset("hdl64"); },
              ThrowsMessage<InputError>(HasSubstr("expected one of hdl-64e hdl-32e")));
}

TEST(SensorPresetsRealDrives, AreGuessed) {
  const char* folder = std::getenv("STILLMAP_REAL_DATA");
  if (folder == nullptr) GTEST_SKIP() << "STILLMAP_REAL_DATA is not set: no real scans";
  const std::filesystem::path data = folder;
  const auto guess = [&](const std::filesystem::path& drive) {
    return guess_sensors(Drive::open(data / drive).read(0));
  };
  EXPECT_THAT(guess("kitti_raw/2011_09_26/2011_09_26_drive_0013_sync"), ElementsAre("hdl-64e"));
  EXPECT_THAT(guess("semantickitti/08"), ElementsAre("hdl-64e"));
  EXPECT_THAT(guess("mulran_seosan01"), Contains("os1-64"));
  EXPECT_THAT(guess("hku_1"), ElementsAre("avia"));
}

}  // namespace sensor_preset_test
}  // namespace stillmap::maps
