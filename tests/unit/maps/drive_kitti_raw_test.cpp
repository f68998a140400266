#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/error.hpp>

#include <cmath>
#include <cstdlib>
#include <numbers>

#include "drives/kitti360.hpp"
#include "drives/oxts.hpp"
#include "scan_bytes.hpp"
#include "support/matchers.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace drive_kitti_raw_test {

using test::IsNearPose;
using test::IsNearVector;
using test::TemporaryFolder;
using test::xyzi;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

constexpr double kPi = std::numbers::pi;
// One second of latitude, in metres, near 49 degrees north (WGS 84: M = 6371 km there); good to
// 1e-3.
constexpr double kMetresPerDegreeNorth = 111'200.0;
const char* const kName = "2011_09_26/2011_09_26_drive_0001_sync";

std::string stamp(double second) { return fmt::format("2011-09-26 13:00:{:012.9f}\n", second); }

std::string oxts(double north_m, double roll, double pitch, double yaw) {
  std::string line = fmt::format("{:.12f} 8.4 110 {} {} {}", 49.0 + north_m / kMetresPerDegreeNorth,
                                 roll, pitch, yaw);
  for (int i = 6; i < 30; ++i) line += " 0";
  return line + "\n";
}

std::string calibration(const char* R = "1 0 0 0 1 0 0 0 1") {
  return "calib_time: 25-May-2012 16:47:16\nR: " + std::string(R) + "\nT: -0.8 0.3 -0.8\n";
}

/// Four scans 0.1 s apart; oxts of a car that drives north at 10 m/s, stamped 30 ms after the
/// scans.
class KittiRawDrive : public ::testing::Test {
 protected:
  KittiRawDrive() {
    std::string stamps;
    std::string starts;
    std::string ends;
    std::string oxts_stamps;
    for (int i = 0; i < 4; ++i) {
      const double t = 10.0 + 0.1 * i;
      stamps += stamp(t);
      starts += stamp(t - 0.05);
      ends += stamp(t + 0.06);
      oxts_stamps += stamp(t + 0.03);
      write(fmt::format("velodyne_points/data/{:010}.bin", i), xyzi(1, 0, 0, 0.5F));
      write(fmt::format("oxts/data/{:010}.txt", i), oxts(1.0 * i, 0, 0, 0.5 * kPi));
    }
    write("velodyne_points/timestamps.txt", stamps);
    write("velodyne_points/timestamps_start.txt", starts);
    write("velodyne_points/timestamps_end.txt", ends);
    write("oxts/timestamps.txt", oxts_stamps);
    folder_.write("2011_09_26/calib_imu_to_velo.txt", calibration());
  }

  void write(const std::string& name, const std::string& text) {
    folder_.write(std::string(kName) + "/" + name, text);
  }
  void remove(const std::string& name) { std::filesystem::remove_all(root() / name); }
  [[nodiscard]] std::filesystem::path root() const { return folder_.path() / kName; }
  void expect_error(const std::string& where, const std::string& what) {
    EXPECT_THAT([&] { (void)Drive::open(root()); },
                ThrowsMessage<InputError>(AllOf(HasSubstr(where), HasSubstr(what))));
  }

  TemporaryFolder folder_;
};

TEST_F(KittiRawDrive, IsRecognisedWithStampsSinceTheEpoch) {
  const Drive drive = Drive::open(root());
  EXPECT_EQ(drive.contents().layout, DriveLayout::kKittiRaw);
  EXPECT_EQ(drive.size(), 4U);
  EXPECT_FALSE(drive.relative_clock());
  // date -u -d '2011-09-26 13:00:10' +%s
  EXPECT_EQ(drive.stamp_ns(0), 1317042010'000000000);
  EXPECT_EQ(drive.stamp_ns(3), 1317042010'300000000);
  EXPECT_THAT(drive.contents().notes, ::testing::IsEmpty());
}

TEST_F(KittiRawDrive, InterpolatesOxtsToTheScansInEastNorthUp) {
  const Drive drive = Drive::open(root());
  ASSERT_TRUE(drive.has_poses());
  ASSERT_TRUE(drive.contents().origin);
  EXPECT_DOUBLE_EQ(drive.contents().origin->latitude_deg, 49.0);
  EXPECT_DOUBLE_EQ(drive.contents().origin->longitude_deg, 8.4);
  EXPECT_DOUBLE_EQ(drive.contents().origin->altitude_m, 110.0);
  // Heading north, x forward is +y of the map. The lidar lies at T_imu_velo = (0.8, -0.3, 0.8) of
  // the imu, thus 0.8 m ahead (north) and 0.3 m to the right (east). Scan 2 is 30 ms before the
  // third packet, at 2 m.
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::AngleAxisd(0.5 * kPi, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  T.translation() << 0.3, 0.8 + 2.0 - 0.3, 0.8;
  EXPECT_THAT(drive.T_map_lidar(2), IsNearPose(T, 0.003, 1e-6));
  // Extrapolated by 30 ms before the first packet.
  T.translation().y() = 0.8 - 0.3;
  EXPECT_THAT(drive.T_map_lidar(0), IsNearPose(T, 0.003, 1e-6));
}

TEST_F(KittiRawDrive, TurnsOxtsAnglesAsTheirFormatSays) {
  remove("velodyne_points/timestamps_start.txt");
  folder_.write("2011_09_26/calib_imu_to_velo.txt", "R: 1 0 0 0 1 0 0 0 1\nT: 0 0 0\n");
  const auto axes = [&](double roll, double pitch, double yaw) {
    for (int i = 0; i < 4; ++i) {
      write(fmt::format("oxts/data/{:010}.txt", i), oxts(0, roll, pitch, yaw));
    }
    return Eigen::Matrix3d(Drive::open(root()).T_map_lidar(0).linear());
  };
  // Yaw 0 is east; positive is counter-clockwise; positive pitch is front down; positive roll is
  // left side up.
  EXPECT_THAT(axes(0, 0, 0).col(0), IsNearVector(Eigen::Vector3d::UnitX(), 1e-9));
  EXPECT_THAT(axes(0, 0, 0.5 * kPi).col(0), IsNearVector(Eigen::Vector3d::UnitY(), 1e-9));
  EXPECT_LT(axes(0, 0.1, 0).col(0).z(), -0.09);
  EXPECT_GT(axes(0.1, 0, 0).col(1).z(), 0.09);
}

TEST_F(KittiRawDrive, KeepsUpAndNorthOfItsOriginFarAway) {
  // 0.1 degrees north of the origin, "up" leans north by just that angle.
  for (int i = 0; i < 4; ++i) {
    write(fmt::format("oxts/data/{:010}.txt", i), oxts(i == 0 ? 0 : 11'120, 0, 0, 0));
  }
  const Drive drive = Drive::open(root());
  EXPECT_NEAR(drive.T_map_lidar(3).linear()(1, 2), 0.1 * kPi / 180.0, 1e-6);
  EXPECT_LT(drive.T_map_lidar(3).translation().z(),
            -8.0);  // the earth curves away: d^2 / 2R = 9.7 m
}

TEST_F(KittiRawDrive, UsesTheInverseOfImuToVelo) {
  // A lidar that looks to the imu's left: its x is the imu's y, so T_velo_imu turns by -90 degrees.
  folder_.write("2011_09_26/calib_imu_to_velo.txt", calibration("0 1 0 -1 0 0 0 0 1"));
  const Eigen::Matrix3d R = Drive::open(root()).T_map_lidar(1).linear();
  // imu x is north, imu y is west; the lidar's x is the imu's y.
  EXPECT_THAT(R.col(0), IsNearVector(Eigen::Vector3d(-1, 0, 0), 1e-6));
}

TEST_F(KittiRawDrive, TellsTimesOfPointsFromAzimuthClockwise) {
  write("velodyne_points/data/0000000001.bin", xyzi(1, 0, 0, 0) + xyzi(0, 1, 0, 0) +
                                                   xyzi(0, -1, 0, 0) + xyzi(-1, 1e-6F, 0, 0) +
                                                   xyzi(-1, -1e-6F, 0, 0));
  const Drive drive = Drive::open(root());
  EXPECT_NEAR(drive.contents().spin_start_end_s[1][0], -0.05, 1e-9);
  EXPECT_NEAR(drive.contents().spin_start_end_s[1][1], 0.06, 1e-9);
  const std::vector<float> times = drive.read(1).cloud.time_offsets_s;
  ASSERT_EQ(times.size(), 5U);
  EXPECT_EQ(times[0], 0.0F);
  EXPECT_NEAR(times[1], -0.025, 1e-6);  // left: a quarter turn before facing ahead
  EXPECT_NEAR(times[2], 0.03, 1e-6);
  EXPECT_NEAR(times[3], -0.05, 1e-6);
  EXPECT_NEAR(times[4], 0.06, 1e-6);
}

TEST_F(KittiRawDrive, WithoutStartAndEndHasNoTimesOfPointsAndSaysSo) {
  remove("velodyne_points/timestamps_end.txt");
  const Drive drive = Drive::open(root());
  EXPECT_TRUE(drive.read(0).cloud.time_offsets_s.empty());
  EXPECT_THAT(drive.contents().notes, Contains(HasSubstr("timestamps_end.txt")));
}

TEST_F(KittiRawDrive, TakesASweepWithImpossibleStartAsTakenAtOnce) {
  write("velodyne_points/timestamps_start.txt",
        stamp(9.95) + stamp(3) + stamp(10.15) + stamp(10.25));
  const Drive drive = Drive::open(root());
  EXPECT_THAT(drive.contents().spin_start_end_s[1], ElementsAre(0.0, 0.0));
  EXPECT_LT(drive.contents().spin_start_end_s[2][0], 0.0);
  EXPECT_THAT(drive.contents().notes, Contains(HasSubstr("1 sweeps have no start or end")));
}

TEST_F(KittiRawDrive, WithMissingScansUsesTheirNumbersAsLines) {
  remove("velodyne_points/data/0000000001.bin");
  remove("velodyne_points/data/0000000002.bin");
  const Drive drive = Drive::open(root());
  ASSERT_EQ(drive.size(), 2U);
  EXPECT_EQ(drive.stamp_ns(1), 1317042010'300000000);
  EXPECT_NEAR(drive.contents().spin_start_end_s[1][1], 0.06, 1e-9);
  EXPECT_NEAR(drive.T_map_lidar(1).translation().y(), 0.8 + 2.7, 0.004);
  EXPECT_THAT(drive.contents().notes, Contains(HasSubstr("2 scans missing on disk: 1 to 2")));
}

TEST_F(KittiRawDrive, WithoutOxtsHasNoPoses) {
  remove("oxts");
  const Drive drive = Drive::open(root());
  EXPECT_FALSE(drive.has_poses());
  EXPECT_FALSE(drive.contents().origin);
  EXPECT_THAT(drive.contents().notes, Contains(HasSubstr("no oxts")));
}

TEST_F(KittiRawDrive, WithoutCalibrationNamesTheFileItNeeds) {
  std::filesystem::remove(folder_.path() / "2011_09_26/calib_imu_to_velo.txt");
  expect_error("2011_09_26/calib_imu_to_velo.txt", "found no file, expected a calibration");
}

TEST_F(KittiRawDrive, WithABrokenCalibrationNamesTheEntry) {
  folder_.write("2011_09_26/calib_imu_to_velo.txt", "R: 1 0 0 0 1 0 0 0\nT: 0 0 0\n");
  expect_error("calib_imu_to_velo.txt", "8 numbers in 'R'");
  folder_.write("2011_09_26/calib_imu_to_velo.txt", "R: 1 0 0 0 1 0 0 0 1\n");
  expect_error("calib_imu_to_velo.txt", "no entry 'T'");
  folder_.write("2011_09_26/calib_imu_to_velo.txt", calibration("1 0 0 0 2 0 0 0 1"));
  expect_error("calib_imu_to_velo.txt", "no rotation");
  folder_.write("2011_09_26/calib_imu_to_velo.txt", "R: 1 0 0 0 1 0 0 0 1\nT: -0.8 1e300 0\n");
  expect_error("calib_imu_to_velo.txt", "sensors -0.8, 1e+300, 0 m apart");
}

TEST_F(KittiRawDrive, WhosePathEndsBeforeAllItsScansIsRefused) {
  write("oxts/timestamps.txt", stamp(5) + stamp(5.1) + stamp(5.2) + stamp(5.3));
  expect_error("oxts", "no pose within 0.2 s of any scan");
}

TEST_F(KittiRawDrive, LeavesOutScansAfterTheEndOfItsPath) {
  write("oxts/timestamps.txt", stamp(9.65) + stamp(9.75) + stamp(9.85) + stamp(9.95));
  const Drive drive = Drive::open(root());
  EXPECT_EQ(drive.size(), 2U);
  EXPECT_EQ(drive.contents().spin_start_end_s.size(), 2U);
  EXPECT_THAT(drive.contents().notes, Contains(HasSubstr("2 scans left out")));
}

TEST_F(KittiRawDrive, NamesWhatIsWrongInItsFiles) {
  write("oxts/data/0000000002.txt", "49 8.4 110 0 0\n");
  expect_error("oxts/data/0000000002.txt", "5 fields");
  write("oxts/data/0000000002.txt", oxts(2, 0, 0, std::nan("")));
  expect_error("oxts/data/0000000002.txt line 1", "'nan'");
  write("oxts/data/0000000002.txt", oxts(2e7, 0, 0, 0));
  expect_error("oxts/data/0000000002.txt", "latitude");
  write("velodyne_points/timestamps.txt", stamp(10) + stamp(10.1));
  expect_error("0000000002.bin", "among 2 lines");
  write("velodyne_points/timestamps.txt", stamp(10) + "2011-13-26 13:00:10.1\n");
  expect_error("timestamps.txt line 2", "'2011-13-26 13:00:10.1'");
}

TEST_F(KittiRawDrive, WithoutScansIsRefused) {
  remove("velodyne_points/data");
  expect_error("velodyne_points/data", "no *.bin");
}

TEST_F(KittiRawDrive, LeavesOutAScanWhoseStampGoesBackAndSaysSo) {
  std::string stamps;
  for (int i = 0; i < 12; ++i) {
    stamps += stamp(i == 5 ? 10.0 : 10.0 + 0.1 * i);
    write(fmt::format("velodyne_points/data/{:010}.bin", i), xyzi(1, 0, 0, 0));
  }
  for (const char* name : {"timestamps", "timestamps_start", "timestamps_end"}) {
    write(std::string("velodyne_points/") + name + ".txt", stamps);
  }
  remove("oxts");
  const Drive drive = Drive::open(root());
  EXPECT_EQ(drive.size(), 11U);
  EXPECT_EQ(drive.contents().scan_files[5].filename(), "0000000006.bin");
  EXPECT_THAT(drive.contents().notes, Contains(HasSubstr("1 scans left out")));
  write("velodyne_points/timestamps.txt", stamps.replace(0, stamp(0).size(), stamp(30)));
  expect_error("drive_0001_sync", "for 2 of 12 scans");
}

TEST_F(KittiRawDrive, TakesGivenPosesInsteadOfItsOwn) {
  std::filesystem::remove(folder_.path() / "2011_09_26/calib_imu_to_velo.txt");
  const auto kitti = folder_.write("given.txt",
                                   "1 0 0 5 0 1 0 0 0 0 1 0\n1 0 0 6 0 1 0 0 0 0 1 0\n"
                                   "1 0 0 7 0 1 0 0 0 0 1 0\n1 0 0 8 0 1 0 0 0 0 1 0\n");
  const Drive drive = Drive::open(root(), kitti);
  EXPECT_EQ(drive.T_map_lidar(3).translation().x(), 8.0);
  EXPECT_FALSE(drive.contents().origin);
  const auto tum =
      folder_.write("given.tum", "1317042010.05 1 0 0 0 0 0 1\n1317042010.25 3 0 0 0 0 0 1\n");
  EXPECT_NEAR(Drive::open(root(), tum).T_map_lidar(1).translation().x(), 1.5, 1e-9);
}

TEST_F(KittiRawDrive, RefusesGivenPosesThatAreTooFewOrElsewhere) {
  const auto few = folder_.write("given.txt", "1 0 0 5 0 1 0 0 0 0 1 0\n");
  EXPECT_THAT([&] { (void)Drive::open(root(), few); },
              ThrowsMessage<InputError>(HasSubstr("given.txt: found 1 poses, expected 4")));
  const auto elsewhere = folder_.write("given.tum", "1 1 0 0 0 0 0 1\n2 3 0 0 0 0 0 1\n");
  EXPECT_THAT([&] { (void)Drive::open(root(), elsewhere); },
              ThrowsMessage<InputError>(HasSubstr("found poses from 1.000 s to 2.000 s")));
  const auto other = folder_.write("given.csv", "1 2 3\n");
  EXPECT_THAT([&] { (void)Drive::open(root(), other); },
              ThrowsMessage<InputError>(HasSubstr("line 1: found 3 fields")));
}

TEST(KittiStamps, AreParsedWithoutLoss) {
  const TemporaryFolder folder;
  const auto file = folder.write("t.txt", "2011-09-26 13:10:51.158069617\n1970-01-01 00:00:00\n");
  EXPECT_THAT(read_kitti_stamps(file), ElementsAre(1317042651158069617, 0));
}

TEST(KittiStamps, OfBlankLinesAreNone) {
  const TemporaryFolder folder;
  const auto file = folder.write("t.txt", "1970-01-01 00:00:00\n\n1970-01-01 00:00:02\n");
  EXPECT_THAT(read_kitti_stamps(file), ElementsAre(0, std::nullopt, 2'000'000'000));
}

TEST_F(KittiRawDrive, NotesAScanThatWasLostWithItsStamp) {
  remove("velodyne_points/data/0000000001.bin");
  for (const char* name : {"timestamps.txt", "timestamps_start.txt", "timestamps_end.txt"}) {
    const double shift = std::string(name) == "timestamps.txt"         ? 0.0
                         : std::string(name) == "timestamps_start.txt" ? -0.05
                                                                       : 0.06;
    write(std::string("velodyne_points/") + name,
          stamp(10.0 + shift) + "\n" + stamp(10.2 + shift) + stamp(10.3 + shift));
  }
  const Drive drive = Drive::open(root());
  EXPECT_EQ(drive.size(), 3U);
  EXPECT_NEAR(drive.T_map_lidar(1).translation().y() - drive.T_map_lidar(0).translation().y(), 2.0,
              2e-3);
  EXPECT_THAT(drive.contents().notes, Contains(HasSubstr("1 scans missing on disk: 1 to 1")));
  // Its scan may be there without a stamp.
  write("velodyne_points/data/0000000001.bin", xyzi(1, 0, 0, 0.5F));
  EXPECT_THAT(Drive::open(root()).contents().notes,
              Contains(HasSubstr("1 scans left out, whose lines of timestamps.txt are blank")));
}

TEST(KittiStamps, RefuseWhatIsNoTime) {
  const TemporaryFolder folder;
  for (const char* text : {"2011-09-26", "2011-02-29 00:00:00", "2011-09-26 24:00:00",
                           "2011-09-26 00:60:00", "2011-09-26 00:00:61", "2011/09/26 00:00:00",
                           "2011-09-26 00:00:", "2011-09-26 00:00:-1", "1000-01-01 00:00:00"}) {
    const auto file = folder.write("t.txt", text);
    EXPECT_THROW((void)read_kitti_stamps(file), InputError) << text;
  }
}

TEST(KittiRawRealDrive, GoesForwardAtTheSpeedThatOxtsReports) {
  const char* folder = std::getenv("STILLMAP_REAL_DATA");
  if (folder == nullptr) GTEST_SKIP() << "STILLMAP_REAL_DATA is not set: no real scans";
  const Drive drive = Drive::open(std::filesystem::path(folder) /
                                  "kitti_raw/2011_09_26/2011_09_26_drive_0013_sync");
  ASSERT_EQ(drive.size(), 80U);
  for (std::size_t i = 1; i + 1 < drive.size(); ++i) {
    const Eigen::Vector3d step =
        drive.T_map_lidar(i).linear().transpose() *
        (drive.T_map_lidar(i + 1).translation() - drive.T_map_lidar(i - 1).translation());
    const double seconds =
        1e-9 * static_cast<double>(drive.stamp_ns(i + 1) - drive.stamp_ns(i - 1));
    // The first packet reports 11.84 m/s; the stamps of oxts are quantised to 10 ms.
    EXPECT_NEAR(step.x() / seconds, 11.5, 1.5) << i;
    EXPECT_NEAR(step.y() / seconds, 0.0, 0.5) << i;
  }
  const Scan scan = drive.read(40);
  EXPECT_GT(scan.cloud.size(), 100'000U);
  EXPECT_EQ(scan.cloud.time_offsets_s.size(), scan.cloud.size());
}

/// The poses of one scan, brought to the lidar.
TEST(Kitti360Poses, OfTheCameraAreOfItsRectifiedAxes) {
  const TemporaryFolder folder;
  const std::string poses = "data_poses/a_sync/";
  folder.write("calibration/calib_cam_to_velo.txt", "0 0 1 0.3 -1 0 0 0.1 0 -1 0 -0.2\n");
  folder.write("calibration/calib_cam_to_pose.txt", "image_00: 0 0 1 1.5 1 0 0 0.3 0 1 0 -0.9\n");
  const double c = std::cos(0.007), s = std::sin(0.007);
  const auto of_imu = lidar_of_kitti360_poses(folder.path() / (poses + "poses.txt"));
  EXPECT_THAT([&] { (void)lidar_of_kitti360_poses(folder.path() / (poses + "cam0_to_world.txt")); },
              test::ThrowsSaying<InputError>({"perspective.txt", "give poses.txt"}));
  folder.write("calibration/perspective.txt",
               fmt::format("calib_time: 25-May-2012 16:47:16\nS_rect_00: 1408 376\n"
                           "R_rect_00: {0} 0 {1} 0 1 0 {2} 0 {0}\nP_rect_00: 1 0 0 0 0 1 0 0 0 0 1 "
                           "0\nR_rect_01: 1 0 0 0 1 0 0 0 1\n",
                           c, s, -s));
  const auto of_camera = lidar_of_kitti360_poses(folder.path() / (poses + "cam0_to_world.txt"));
  // T_world_imu T_imu_cam = T_world_rectified R_rect_00, as kitti360scripts has it.
  Eigen::Isometry3d T_imu_cam = Eigen::Isometry3d::Identity(), R_rect = T_imu_cam;
  T_imu_cam.matrix().topRows<3>() << 0, 0, 1, 1.5, 1, 0, 0, 0.3, 0, 1, 0, -0.9;
  R_rect.linear() << c, 0, s, 0, 1, 0, -s, 0, c;
  const Eigen::Isometry3d T_imu_rectified = T_imu_cam * R_rect.inverse();
  EXPECT_THAT(T_imu_rectified * of_camera.value(), IsNearPose(of_imu.value(), 1e-9, 1e-9));
  folder.write("calibration/perspective.txt", "P_rect_00: 1 0 0 0 0 1 0 0 0 0 1 0\n");
  EXPECT_THAT([&] { (void)lidar_of_kitti360_poses(folder.path() / (poses + "cam0_to_world.txt")); },
              test::ThrowsSaying<InputError>({"perspective.txt", "no line R_rect_00:"}));
}

}  // namespace drive_kitti_raw_test
}  // namespace stillmap::maps
