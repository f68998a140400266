#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/error.hpp>

#include <cstdlib>

#include "support/temporary_folder.hpp"

namespace stillmap::maps {
namespace drive_keyframes_test {

using test::TemporaryFolder;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::ThrowsMessage;

const char* const kPcd =
    "VERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH 1\n"
    "HEIGHT 1\nPOINTS 1\nDATA ascii\n1 2 3 4\n";
const char* const kPoses = "1 0 0 5 0 1 0 0 0 0 1 0\n1 0 0 6 0 1 0 0 0 0 1 0\n";

class KeyframesDrive : public ::testing::Test {
 protected:
  KeyframesDrive() {
    folder_.write("Scans/000000.pcd", kPcd);
    folder_.write("Scans/000001.pcd", kPcd);
    folder_.write("optimized_poses.txt", kPoses);
    folder_.write("times.txt", "1577836980.0991046\n1577836987.3982084\n");
  }
  void remove(const char* name) { std::filesystem::remove_all(folder_.path() / name); }
  [[nodiscard]] Drive open() const { return Drive::open(folder_.path()); }
  void expect_error(const std::string& where, const std::string& what) {
    EXPECT_THAT([&] { (void)open(); },
                ThrowsMessage<InputError>(AllOf(HasSubstr(where), HasSubstr(what))));
  }

  TemporaryFolder folder_;
};

TEST_F(KeyframesDrive, IsRecognisedWithItsPosesAndStampsWithoutLoss) {
  const Drive drive = open();
  EXPECT_EQ(drive.contents().layout, DriveLayout::kKeyframes);
  EXPECT_FALSE(drive.relative_clock());
  EXPECT_THAT(drive.contents().stamps_ns, ElementsAre(1577836980099104600, 1577836987398208400));
  EXPECT_EQ(drive.T_map_lidar(1).translation(), Eigen::Vector3d(6, 0, 0));
  EXPECT_THAT(drive.contents().notes, IsEmpty());
  const Scan scan = drive.read(1);
  EXPECT_EQ(scan.index, 1U);
  EXPECT_EQ(scan.stamp_ns, 1577836987398208400);
  EXPECT_THAT(scan.source, HasSubstr("000001.pcd"));
  EXPECT_THAT(scan.cloud.intensities, ElementsAre(4.0F));
}

TEST_F(KeyframesDrive, WithSmallTimesHasARelativeClock) {
  folder_.write("times.txt", "0.5\n1.5\n");
  EXPECT_TRUE(open().relative_clock());
}

TEST_F(KeyframesDrive, PrefersOptimizedPosesAndSaysWhenThereAreOnlyOdometrys) {
  folder_.write("odom_poses.txt", "1 0 0 7 0 1 0 0 0 0 1 0\n1 0 0 8 0 1 0 0 0 0 1 0\n");
  EXPECT_EQ(open().T_map_lidar(1).translation().x(), 6.0);
  remove("optimized_poses.txt");
  const Drive drive = open();
  EXPECT_EQ(drive.T_map_lidar(1).translation().x(), 8.0);
  EXPECT_THAT(drive.contents().notes, Contains(HasSubstr("odometry")));
}

TEST_F(KeyframesDrive, TakesGivenPosesInstead) {
  const auto tum =
      folder_.write("given.tum", "1577836980 0 0 0 0 0 0 1\n1577836990 10 0 0 0 0 0 1\n");
  EXPECT_NEAR(Drive::open(folder_.path(), tum).T_map_lidar(1).translation().x(), 7.3982084, 1e-9);
}

TEST_F(KeyframesDrive, SaysWhenScansLieInAGapOfThePath) {
  const auto tum =
      folder_.write("given.tum", "1577836980 0 0 0 0 0 0 1\n1577836990 10 0 0 0 0 0 1\n");
  EXPECT_THAT(Drive::open(folder_.path(), tum).contents().notes,
              Contains(HasSubstr("2 scans lie in gaps")));
}

TEST_F(KeyframesDrive, WithScansInLowerCaseIsTheSame) {
  std::filesystem::rename(folder_.path() / "Scans", folder_.path() / "scans");
  EXPECT_EQ(open().contents().layout, DriveLayout::kKeyframes);
}

TEST_F(KeyframesDrive, WithBothFoldersOfScansIsContradictory) {
  folder_.write("scans/000000.pcd", kPcd);
  expect_error(folder_.path().string(), "both Scans/ and scans/");
}

TEST_F(KeyframesDrive, WithFewerPosesOrTimesThanScansIsRefused) {
  folder_.write("times.txt", "1\n");
  expect_error("times.txt", "found 1 times, expected 2");
  folder_.write("times.txt", "1\n2 3\n");
  expect_error("times.txt line 2", "one time in seconds");
  folder_.write("times.txt", "1\n2\n");
  folder_.write("optimized_poses.txt", "1 0 0 5 0 1 0 0 0 0 1 0\n");
  expect_error("optimized_poses.txt", "found 1 poses, expected 2");
}

TEST(KeyframesRealDrives, OpenWhole) {
  const char* folder = std::getenv("STILLMAP_REAL_DATA");
  if (folder == nullptr) GTEST_SKIP() << "STILLMAP_REAL_DATA is not set: no real scans";
  const Drive hku = Drive::open(std::filesystem::path(folder) / "hku_1");
  EXPECT_EQ(hku.size(), 314U);
  EXPECT_EQ(hku.stamp_ns(0), 1577836980099104600);
  const Drive mulran = Drive::open(std::filesystem::path(folder) / "mulran_seosan01");
  ASSERT_EQ(mulran.size(), 21U);
  EXPECT_EQ(mulran.read(0).points_in_file, 62'082U);
}

}  // namespace drive_keyframes_test
}  // namespace stillmap::maps
