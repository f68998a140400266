#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/error.hpp>

#include <cstdlib>

#include "scan_bytes.hpp"
#include "support/matchers.hpp"
#include "support/temporary_folder.hpp"

namespace stillmap::maps {
namespace drive_kitti_odometry_test {

using test::IsNearVector;
using test::TemporaryFolder;
using test::xyzi;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

// Camera: x right, y down, z ahead. The lidar lies 0.08 m above and 0.27 m behind it.
const char* const kTr = "0 -1 0 0 0 0 -1 -0.08 1 0 0 -0.27\n";
const char* const kCalibration =
    "P0: 7 0 6 0 0 7 1 0 0 0 1 0\nTr: 0 -1 0 0 0 0 -1 -0.08 1 0 0 -0.27\n";
// The camera moves 0, 1 and 2 m ahead, which is its z.
const char* const kPoses =
    "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 0 0 0 1 1\n1 0 0 0 0 1 0 0 0 0 1 2\n";

class KittiOdometryDrive : public ::testing::Test {
 protected:
  KittiOdometryDrive() {
    for (const char* name : {"000000", "000001", "000002"}) {
      write(std::string("velodyne/") + name + ".bin", xyzi(1, 2, 3, 0.5F) + xyzi(4, 5, 6, 0.5F));
    }
    write("calib.txt", kCalibration);
    write("poses.txt", kPoses);
    write("times.txt", "0.000000e+00\n1.037359e-01\n2.074718e-01\n");
  }
  void write(const std::string& name, const std::string& text) {
    folder_.write("dataset/sequences/07/" + name, text);
  }
  void remove(const std::string& name) { std::filesystem::remove_all(root() / name); }
  [[nodiscard]] std::filesystem::path root() const {
    return folder_.path() / "dataset/sequences/07";
  }
  void expect_error(const std::string& where, const std::string& what) {
    EXPECT_THAT([&] { (void)Drive::open(root()); },
                ThrowsMessage<InputError>(AllOf(HasSubstr(where), HasSubstr(what))));
  }

  TemporaryFolder folder_;
};

TEST_F(KittiOdometryDrive, IsRecognisedWithARelativeClock) {
  const Drive drive = Drive::open(root());
  EXPECT_EQ(drive.contents().layout, DriveLayout::kKittiOdometry);
  EXPECT_TRUE(drive.relative_clock());
  EXPECT_THAT(drive.contents().stamps_ns, ElementsAre(0, 103'735'900, 207'471'800));
  EXPECT_THAT(drive.contents().notes, ::testing::IsEmpty());
  EXPECT_THAT(drive.read(1).cloud.time_offsets_s, ::testing::IsEmpty());
}

TEST_F(KittiOdometryDrive, TurnsCameraPosesToTheLidar) {
  const Drive drive = Drive::open(root());
  EXPECT_THAT(drive.T_map_lidar(0).matrix().reshaped(),
              IsNearVector(Eigen::Matrix4d::Identity().reshaped(), 1e-15));
  // Ahead of the camera is ahead of the lidar: +x.
  EXPECT_THAT(drive.T_map_lidar(2).translation(), IsNearVector(Eigen::Vector3d(2, 0, 0), 1e-14));
}

TEST_F(KittiOdometryDrive, TurnsAroundTheLidarNotTheCamera) {
  // The camera turns left by 90 degrees on the spot: the lidar, 0.27 m behind it, swings to its
  // right.
  write("poses.txt",
        "0 0 -1 0 0 1 0 0 1 0 0 0\n0 0 -1 0 0 1 0 0 1 0 0 0\n0 0 -1 0 0 1 0 0 1 0 0 0\n");
  const Eigen::Isometry3d T = Drive::open(root()).T_map_lidar(0);
  EXPECT_THAT(T.linear().col(0), IsNearVector(Eigen::Vector3d::UnitY(), 1e-15));
  EXPECT_THAT(T.translation(), IsNearVector(Eigen::Vector3d(0.27, -0.27, 0), 1e-15));
}

TEST_F(KittiOdometryDrive, ReadsEveryNameOfTheCalibration) {
  for (const char* key : {"Tr: ", "Tr_velo_to_cam: ", "Tr_velo_cam "}) {
    write("calib.txt", std::string(key) + kTr);
    EXPECT_NEAR(Drive::open(root()).T_map_lidar(2).translation().x(), 2.0, 1e-14) << key;
  }
}

TEST_F(KittiOdometryDrive, FindsPosesBesideTheSequences) {
  remove("poses.txt");
  folder_.write("dataset/poses/07.txt", kPoses);
  EXPECT_NEAR(Drive::open(root()).T_map_lidar(2).translation().x(), 2.0, 1e-14);
  EXPECT_NEAR(Drive::open(root() / "").T_map_lidar(2).translation().x(), 2.0, 1e-14);
}

TEST_F(KittiOdometryDrive, WithoutPosesNeedsNoCalibration) {
  remove("poses.txt");
  remove("calib.txt");
  const Drive drive = Drive::open(root());
  EXPECT_FALSE(drive.has_poses());
  EXPECT_THROW((void)drive.T_map_lidar(0), std::out_of_range);
}

TEST_F(KittiOdometryDrive, WithPosesButNoCalibrationIsRefused) {
  remove("calib.txt");
  expect_error("calib.txt", "found no file");
  write("calib.txt", "P0: 7 0 6 0 0 7 1 0 0 0 1 0\n");
  expect_error("calib.txt", "no entry for velodyne to camera");
}

TEST_F(KittiOdometryDrive, WithFewerPosesOrTimesThanScansNamesBothCounts) {
  write("poses.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 0 0 0 1 1\n");
  expect_error("poses.txt", "found 2 poses, expected 3");
  write("poses.txt", kPoses);
  write("times.txt", "0\n0.1\n");
  expect_error("times.txt", "found 2 times, expected 3");
}

TEST_F(KittiOdometryDrive, OfWhichOnlySomeScansAreThereUsesTheirNumbers) {
  remove("velodyne/000001.bin");
  const Drive drive = Drive::open(root());
  EXPECT_EQ(drive.stamp_ns(1), 207'471'800);
  EXPECT_NEAR(drive.T_map_lidar(1).translation().x(), 2.0, 1e-14);
}

TEST_F(KittiOdometryDrive, WithNumbersBeyondItsPosesIsRefused) {
  remove("velodyne/000001.bin");
  write("velodyne/000009.bin", xyzi(1, 2, 3, 0));
  remove("velodyne/000002.bin");
  expect_error("times.txt", "000009.bin is not");
}

TEST_F(KittiOdometryDrive, WithoutTimesTakesATenthOfASecondAndSaysSo) {
  remove("times.txt");
  const Drive drive = Drive::open(root());
  EXPECT_THAT(drive.contents().stamps_ns, ElementsAre(0, 100'000'000, 200'000'000));
  EXPECT_THAT(drive.contents().notes, Contains(HasSubstr("0.1 s apart")));
}

std::string labels(std::initializer_list<std::uint32_t> values) {
  std::string bytes;
  for (const std::uint32_t value : values) test::append(bytes, value);
  return bytes;
}

TEST_F(KittiOdometryDrive, ReadsLabelsOfEveryPointOfTheFile) {
  write("velodyne/000000.bin", xyzi(0, 0, 0, 0) + xyzi(1, 1, 1, 0));
  write("labels/000000.label", labels({10, 0x0001'00FC}));
  const Drive drive = Drive::open(root());
  EXPECT_EQ(drive.read(0).cloud.size(), 1U);
  EXPECT_THAT(drive.read_labels(0), ElementsAre(10U, 0x0001'00FCU));
  EXPECT_THAT(drive.read_labels(1), ::testing::IsEmpty());
  EXPECT_THAT(drive.contents().notes, Contains(HasSubstr("2 scans without labels")));
}

TEST_F(KittiOdometryDrive, RefusesLabelsOfAnotherCount) {
  write("labels/000000.label", labels({10, 11, 12}));
  const Drive drive = Drive::open(root());
  EXPECT_THAT([&] { (void)drive.read_labels(0); },
              ThrowsMessage<InputError>(HasSubstr("000000.label: found 12 bytes, expected 8")));
}

TEST_F(KittiOdometryDrive, HasNoLabelsWithoutAFolderOfThem) {
  EXPECT_THAT(Drive::open(root()).read_labels(0), ::testing::IsEmpty());
}

TEST_F(KittiOdometryDrive, NamesTheScanThatIsBrokenOnlyWhenItIsRead) {
  write("velodyne/000001.bin", xyzi(1, 2, 3, 0) + "x");
  const Drive drive = Drive::open(root());
  EXPECT_EQ(drive.read(0).cloud.size(), 2U);
  EXPECT_THAT([&] { (void)drive.read(1); },
              ThrowsMessage<InputError>(HasSubstr("000001.bin: found 17 bytes")));
  EXPECT_THROW((void)drive.read(3), std::out_of_range);
}

TEST_F(KittiOdometryDrive, BesideAnotherLayoutIsContradictory) {
  write("velodyne_points/data/0000000000.bin", "");
  expect_error("sequences/07", "both kitti_raw and kitti_odometry");
}

TEST(KittiOdometryRealScan, OpensWithLabelsAlone) {
  const char* folder = std::getenv("STILLMAP_REAL_DATA");
  if (folder == nullptr) GTEST_SKIP() << "STILLMAP_REAL_DATA is not set: no real scans";
  const Drive drive = Drive::open(std::filesystem::path(folder) / "semantickitti/08");
  ASSERT_EQ(drive.size(), 1U);
  EXPECT_FALSE(drive.has_poses());
  EXPECT_EQ(drive.read_labels(0).size(), drive.read(0).points_in_file);
}

}  // namespace drive_kitti_odometry_test
}  // namespace stillmap::maps
