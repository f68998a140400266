#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <cmath>

#include "drives/layout.hpp"
#include "scan_bytes.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace drive_scan_folder_test {

using test::TemporaryFolder;
using test::xyzi;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

const char* const kPcd =
    "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 1\nHEIGHT 1\nPOINTS 1\n"
    "DATA ascii\n1 2 3\n";
const char* const kTwoKitti = "1 0 0 5 0 1 0 0 0 0 1 0\n1 0 0 6 0 1 0 0 0 0 1 0\n";

class ScanFolderDrive : public ::testing::Test {
 protected:
  [[nodiscard]] Drive open() const { return Drive::open(folder_.path()); }
  void expect_error(const std::string& where, const std::string& what) {
    EXPECT_THAT([&] { (void)open(); },
                ThrowsMessage<InputError>(AllOf(HasSubstr(where), HasSubstr(what))));
  }
  TemporaryFolder folder_;
};

TEST_F(ScanFolderDrive, SortsNamesByTheirNumbers) {
  for (const char* name : {"scan10.pcd", "scan9.pcd", "scan2.pcd", "scan010.pcd"}) {
    folder_.write(name, kPcd);
  }
  const Drive drive = open();
  std::vector<std::string> names;
  for (const auto& file : drive.contents().scan_files) names.push_back(file.filename().string());
  EXPECT_THAT(names, ElementsAre("scan2.pcd", "scan9.pcd", "scan010.pcd", "scan10.pcd"));
}

TEST_F(ScanFolderDrive, HasNoPosesAndATenthOfASecondWithoutFilesOfThem) {
  folder_.write("a.bin", xyzi(1, 2, 3, 4));
  folder_.write("b.bin", xyzi(1, 2, 3, 4));
  const Drive drive = open();
  EXPECT_EQ(drive.contents().layout, DriveLayout::kScanFolder);
  EXPECT_FALSE(drive.has_poses());
  EXPECT_TRUE(drive.relative_clock());
  EXPECT_THAT(drive.contents().stamps_ns, ElementsAre(0, kAssumedPeriodNs));
  EXPECT_EQ(drive.contents().notes.size(), 1U);
}

/// Points of a street with more numbers each than x y z intensity.
std::string points_with(std::size_t columns) {
  std::string bytes;
  for (int i = 0; i < 1500; ++i) {
    const float angle = 0.01F * static_cast<float>(i);
    const float range = 5.0F + static_cast<float>(i % 37);
    const float values[] = {range * std::cos(angle),
                            range * std::sin(angle),
                            0.05F * static_cast<float>(i % 40) - 1.7F,
                            static_cast<float>(i % 250),
                            static_cast<float>(i % 32),
                            0.1F * static_cast<float>(i) / 1500.0F};
    for (std::size_t c = 0; c < columns; ++c) test::append(bytes, values[c]);
  }
  return bytes;
}

TEST_F(ScanFolderDrive, OffersTheColumnsThatABinLooksLike) {
  folder_.write("a.pcd.bin", points_with(4));
  EXPECT_EQ(open().read(0).cloud.size(), 1500U);
  // 1,500 points of five numbers are 1,875 of four.
  folder_.write("a.pcd.bin", points_with(5));
  expect_error("numbers that are not x y z intensity: they look like 5 a point", "?columns=xyzir'");
  const Drive drive = Drive::open(folder_.path().string() + "?columns=xyzir");
  EXPECT_EQ(drive.read(0).cloud.size(), 1500U);
  EXPECT_EQ(drive.read(0).cloud.intensities[100], 100.0F);
  folder_.write("a.pcd.bin", points_with(6));
  expect_error("look like 6 a point", "?columns=xyzirt'");
  EXPECT_NEAR(
      Drive::open(folder_.path().string() + "?columns=xyzirt").read(0).cloud.time_offsets_s[750],
      0.05F, 1e-6F);
  folder_.write("a.pcd.bin", points_with(3));
  expect_error("look like 3 a point", "?columns=xyz'");
}

TEST_F(ScanFolderDrive, HoldsScansOfDaysThatLieFarApart) {
  for (const char* name : {"1600000000000000000", "1650000000000000000", "1650000000100000000"})
    folder_.write(std::string(name) + ".pcd", kPcd);
  EXPECT_EQ(open().size(), 3U);
}

TEST_F(ScanFolderDrive, RefusesColumnsThatAreNone) {
  folder_.write("a.bin", points_with(4));
  for (const char* columns : {"xyq", "xxyz", "xyi", "xyziitt"})
    EXPECT_THAT([&] { (void)Drive::open(folder_.path().string() + "?columns=" + columns); },
                ThrowsMessage<InputError>(HasSubstr("a letter for each float32 of a point")));
  std::filesystem::remove(folder_.path() / "a.bin");
  folder_.write("a.pcd", kPcd);
  EXPECT_THAT([&] { (void)Drive::open(folder_.path().string() + "?columns=xyzir"); },
              ThrowsMessage<InputError>(HasSubstr("scans that are no *.bin")));
}

TEST_F(ScanFolderDrive, FindsLabelsByTheScansNames) {
  folder_.write("a.bin", xyzi(1, 2, 3, 4));
  folder_.write("b.bin", xyzi(1, 2, 3, 4));
  folder_.write("labels/b.label", std::string("\x28\0\0\0", 4));
  const Drive drive = open();
  EXPECT_TRUE(drive.read_labels(0).empty());
  EXPECT_THAT(drive.read_labels(1), ElementsAre(40U));
}

TEST_F(ScanFolderDrive, TakesScansFromOneFolderBelow) {
  folder_.write("clouds/a.pcd", kPcd);
  folder_.write("clouds/b.pcd", kPcd);
  folder_.write("images/a.png", "");
  folder_.write("poses.txt", kTwoKitti);
  EXPECT_EQ(open().T_map_lidar(1).translation().x(), 6.0);
}

TEST_F(ScanFolderDrive, TakesPosesBesideScansInOneFolderBelowUnlessItHasItsOwn) {
  folder_.write("drive/a.pcd", kPcd);
  folder_.write("drive/b.pcd", kPcd);
  folder_.write("drive/poses.tum", "1 3 0 0 0 0 0 1\n2 4 0 0 0 0 0 1\n");
  EXPECT_EQ(open().T_map_lidar(1).translation().x(), 4.0);
  folder_.write("poses.txt", kTwoKitti);
  EXPECT_EQ(open().T_map_lidar(1).translation().x(), 6.0);
}

TEST_F(ScanFolderDrive, MatchesATrajectoryLineByLineWhenNamesAreNoStamps) {
  folder_.write("a.pcd", kPcd);
  folder_.write("b.pcd", kPcd);
  folder_.write("trajectory.tum", "1624254615.786958 1 0 0 0 0 0 1\n1624254616.5 2 0 0 0 0 0 1\n");
  const Drive drive = open();
  EXPECT_THAT(drive.contents().stamps_ns, ElementsAre(1624254615786958000, 1624254616500000000));
  EXPECT_FALSE(drive.relative_clock());
  EXPECT_EQ(drive.T_map_lidar(1).translation().x(), 2.0);
  folder_.write("c.pcd", kPcd);
  expect_error("trajectory.tum", "found 2 poses, expected 3");
}

TEST_F(ScanFolderDrive, InterpolatesATrajectoryToStampsInNames) {
  folder_.write("1624254615500000000.pcd", kPcd);
  folder_.write("1624254615750000000.pcd", kPcd);
  folder_.write("any.tum", "1624254615 0 0 0 0 0 0 1\n1624254616 1 0 0 0 0 0 1\n");
  const Drive drive = open();
  EXPECT_EQ(drive.stamp_ns(0), 1624254615500000000);
  EXPECT_FALSE(drive.relative_clock());
  EXPECT_NEAR(drive.T_map_lidar(1).translation().x(), 0.75, 1e-9);
}

TEST_F(ScanFolderDrive, ShiftsATrajectoryInTime) {
  folder_.write("1624254615500000000.pcd", kPcd);
  folder_.write("1624254615750000000.pcd", kPcd);
  folder_.write("1624254652750000000.pcd", kPcd);
  folder_.write("any.tum",
                "1624254615 0 0 0 0 0 0 1\n1624254616 1 0 0 0 0 0 1\n"
                "1624254617 2 0 0 0 0 0 1\n");
  const Drive drive = Drive::open(folder_.path(), std::nullopt, 37'000'000'000);
  ASSERT_EQ(drive.size(), 1U);
  EXPECT_EQ(drive.stamp_ns(0), 1624254652750000000);
  EXPECT_NEAR(drive.T_map_lidar(0).translation().x(), 0.75, 1e-9);
  EXPECT_EQ(drive.contents().path->poses().front().stamp_ns, 1624254652000000000);
  EXPECT_EQ(drive.contents().path->size(), 3U);
}

TEST_F(ScanFolderDrive, RefusesAShiftBeyondAllStamps) {
  folder_.write("1624254615500000000.pcd", kPcd);
  folder_.write("any.tum", "1624254615 0 0 0 0 0 0 1\n9000000000 1 0 0 0 0 0 1\n");
  EXPECT_THAT([&] { (void)Drive::open(folder_.path(), std::nullopt, 1'000'000'000'000'000'000); },
              test::ThrowsSaying<InputError>(
                  {"any.tum", "9000000000000000000 ns", "a smaller --pose-time-offset"}));
}

TEST_F(ScanFolderDrive, ShiftsPosesThatComeOneAScan) {
  for (const char* name : {"1624254615.0.pcd", "1624254615.1.pcd", "1624254615.2.pcd"})
    folder_.write(name, kPcd);
  folder_.write("poses.txt",
                "1 0 0 5 0 1 0 0 0 0 1 0\n1 0 0 6 0 1 0 0 0 0 1 0\n1 0 0 7 0 1 0 0 0 0 1 0\n");
  EXPECT_FALSE(open().contents().path) << "such poses have no clock of their own";
  const Drive drive = Drive::open(folder_.path(), std::nullopt, 50'000'000);
  ASSERT_EQ(drive.size(), 3U);
  EXPECT_NEAR(drive.T_map_lidar(1).translation().x(), 5.5, 1e-6);
  EXPECT_NEAR(drive.T_map_lidar(0).translation().x(), 4.5, 1e-6);
}

TEST_F(ScanFolderDrive, LeavesOutScansBeforeAndAfterTheTrajectory) {
  for (int i = 0; i < 6; ++i) {
    const std::string name = std::to_string(1624254610 + i) + "000000000";
    folder_.write(name + ".bin", xyzi(static_cast<float>(i), 2, 3, 4));
    folder_.write("labels/" + name + ".label", std::string{static_cast<char>(i), '\0', '\0', '\0'});
  }
  folder_.write("any.tum",
                "1624254611.1 1 0 0 0 0 0 1\n1624254612 2 0 0 0 0 0 1\n"
                "1624254612.9 3 0 0 0 0 0 1\n");
  const Drive drive = open();
  EXPECT_THAT(drive.contents().notes,
              ElementsAre("3 scans left out, which have no pose in any.tum; the others count from "
                          "0"));
  ASSERT_EQ(drive.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(drive.stamp_ns(i), 1624254611000000000 + static_cast<std::int64_t>(i) * 1000000000);
    EXPECT_NEAR(drive.T_map_lidar(i).translation().x(), static_cast<double>(i + 1), 0.2);
    EXPECT_EQ(drive.read(i).cloud.positions[0].x(), static_cast<float>(i + 1));
    EXPECT_THAT(drive.read_labels(i), ElementsAre(i + 1));
  }
  EXPECT_THAT([&] { drive.require_own_numbers("my.boxes.json"); },
              ThrowsMessage<InputError>(HasSubstr("numbers of scans in my.boxes.json")));
  folder_.write("any.tum", "1624254610 0 0 0 0 0 0 1\n1624254613 3 0 0 0 0 0 1\n");
  open().require_own_numbers("my.boxes.json");
  folder_.write("any.tum", "1624254620 1 0 0 0 0 0 1\n1624254621 2 0 0 0 0 0 1\n");
  expect_error("any.tum",
               "no pose within 0.2 s of any scan, expected poses of scans from "
               "1624254610.000 s to 1624254615.000 s");
}

TEST_F(ScanFolderDrive, ReadsStampsInNamesOfSecondsAndMicroseconds) {
  folder_.write("1624254615.5.pcd", kPcd);
  EXPECT_EQ(open().stamp_ns(0), 1624254615500000000);
  std::filesystem::remove(folder_.path() / "1624254615.5.pcd");
  folder_.write("1624254615500001.pcd", kPcd);
  EXPECT_EQ(open().stamp_ns(0), 1624254615500001000);
}

TEST_F(ScanFolderDrive, TakesAGivenFileOverItsOwn) {
  folder_.write("a.pcd", kPcd);
  folder_.write("b.pcd", kPcd);
  folder_.write("poses.txt", kTwoKitti);
  const auto given = folder_.write("x.tum", "1 9 0 0 0 0 0 1\n2 8 0 0 0 0 0 1\n");
  EXPECT_EQ(Drive::open(folder_.path(), given).T_map_lidar(1).translation().x(), 8.0);
  expect_error(folder_.path().string(), "x.tum and poses.txt");
}

TEST_F(ScanFolderDrive, SaysWhichFileOfPosesItTakesOrRefusesToChoose) {
  folder_.write("a.pcd", kPcd);
  folder_.write("b.pcd", kPcd);
  const std::string graph = "VERTEX_SE3:QUAT 0 5 0 0 0 0 0 1\nVERTEX_SE3:QUAT 1 6 0 0 0 0 0 1\n";
  folder_.write("one.g2o", graph);
  EXPECT_EQ(open().T_map_lidar(1).translation().x(), 6.0);
  folder_.write("two.g2o", graph);
  expect_error(folder_.path().string(), "one.g2o and two.g2o");
  std::filesystem::remove(folder_.path() / "two.g2o");
  folder_.write("poses.csv", "x,y,z,qx,qy,qz,qw\n1,0,0,0,0,0,1\n2,0,0,0,0,0,1\n");
  expect_error(folder_.path().string(), "one.g2o and poses.csv");
  folder_.write("poses.txt", kTwoKitti);
  EXPECT_THAT(
      open().contents().notes,
      ::testing::IsSupersetOf({"poses are those of poses.txt, not of one.g2o beside it",
                               "poses are those of poses.txt, not of poses.csv beside it"}));
}

class NumberedScans : public ScanFolderDrive {
 protected:
  void write_scans(int first, int count) {
    for (int i = first; i < first + count; ++i) folder_.write(fmt::format("{:06d}.pcd", i), kPcd);
  }
  /// A vertex of each number, at x = the number.
  void write_graph(const std::vector<int>& numbers) {
    std::string text;
    for (const int i : numbers) text += fmt::format("VERTEX_SE3:QUAT {0} {0} 0 0 0 0 0 1\n", i);
    folder_.write("a.g2o", text);
  }
  [[nodiscard]] std::vector<double> xs() const {
    const Drive drive = open();
    std::vector<double> xs;
    for (std::size_t i = 0; i < drive.size(); ++i)
      xs.push_back(drive.T_map_lidar(i).translation().x());
    return xs;
  }
  void expect_note(const std::string& part, bool is_there) const {
    const std::vector<std::string> notes = open().contents().notes;
    const bool found = std::any_of(notes.begin(), notes.end(), [&](const std::string& note) {
      return note.find(part) != std::string::npos;
    });
    EXPECT_EQ(found, is_there) << part;
  }
};

TEST_F(NumberedScans, KeepTheirPosesWhereOneIsMissing) {
  write_scans(0, 10);
  write_graph({0, 1, 2, 3, 4, 6, 7, 8, 9, 10});
  const std::vector<double> found = xs();
  ASSERT_EQ(found.size(), 10U);
  for (std::size_t i = 0; i < 10; ++i) EXPECT_NEAR(found[i], static_cast<double>(i), 1e-9) << i;
  expect_note("assigned in order", false);
}

TEST_F(NumberedScans, GetPosesInOrderWhereAllNumbersAreShiftedOrNoneIsTheirs) {
  write_scans(0, 4);
  write_graph({1, 2, 3, 4});
  EXPECT_THAT(xs(), ElementsAre(1.0, 2.0, 3.0, 4.0));
  expect_note("the numbers in a.g2o, 1 to 4, are not those of the scans", true);
  write_graph({100, 117, 130, 160});
  EXPECT_THAT(xs(), ElementsAre(100.0, 117.0, 130.0, 160.0));
  expect_note("assigned in order", true);
}

TEST_F(NumberedScans, OfOneStampGetOnePose) {
  write_scans(0, 4);
  const auto poses = folder_.write("poses/p.g2o",
                                   "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n"
                                   "VERTEX_SE3:QUAT 1 1 0 0 0 0 0 1\n"
                                   "VERTEX_SE3:QUAT 2 2 0 0 0 0 0 1\n"
                                   "VERTEX_SE3:QUAT 3 3 0 0 0 0 0 1\n");
  Drive::Contents contents = open().contents();
  contents.stamps_ns = {0, 100'000'000, 100'000'000, 200'000'000};
  set_poses(contents, poses, 0);
  EXPECT_EQ(contents.path->size(), 3U);
  EXPECT_EQ(contents.T_map_lidar.at(3).translation().x(), 3.0);
  EXPECT_THAT(contents.notes, ::testing::Contains(HasSubstr("1 poses in p.g2o are left out")));
}

TEST_F(NumberedScans, NeedARowEachOfATableWithoutStampsAndNumbers) {
  write_scans(0, 2);
  const std::string header = "clock_of_mine,x,y,z,qx,qy,qz,qw\n";
  folder_.write("poses.csv", header + "1,1,0,0,0,0,0,1\n2,2,0,0,0,0,0,1\n");
  EXPECT_THAT(xs(), ElementsAre(1.0, 2.0));
  expect_note("poses in poses.csv have neither stamp nor number: they are assigned in order", true);
  folder_.write("poses.csv", header + "1,1,0,0,0,0,0,1\n2,2,0,0,0,0,0,1\n3,3,0,0,0,0,0,1\n");
  expect_error("poses.csv", "3 poses without stamp or number");
}

TEST_F(ScanFolderDrive, RefusesToShiftTheViewpointsOfPointsInTheMap) {
  for (int i = 0; i < 3; ++i) {
    std::string pcd = kPcd;
    pcd.insert(pcd.find("POINTS"), fmt::format("VIEWPOINT {} 0 0 1 0 0 0\n", i));
    folder_.write(fmt::format("{}.pcd", i), pcd);
  }
  const std::string drive = folder_.path().string() + "?points=map";
  EXPECT_EQ(Drive::open(drive).T_map_lidar(2).translation().x(), 2.0);
  EXPECT_THAT([&] { (void)Drive::open(drive, std::nullopt, 50'000'000); },
              test::ThrowsSaying<InputError>({"--pose-time-offset", "leave it out"}));
  const Drive of_sensor =
      Drive::open(folder_.path().string() + "?points=sensor", std::nullopt, 50'000'000);
  EXPECT_NEAR(of_sensor.T_map_lidar(1).translation().x(), 0.5, 1e-6);
}

TEST_F(ScanFolderDrive, RefusesMixedKinds) {
  folder_.write("a.pcd", kPcd);
  folder_.write("b.bin", xyzi(1, 2, 3, 4));
  expect_error(folder_.path().string(), "*.pcd and *.bin");
}

TEST_F(ScanFolderDrive, RefusesScansInSeveralFolders) {
  folder_.write("one/a.pcd", kPcd);
  folder_.write("two/a.pcd", kPcd);
  expect_error(folder_.path().string(), "scans in one/ two/");
}

TEST_F(ScanFolderDrive, RefusesFewerPosesThanScans) {
  for (const char* name : {"a.pcd", "b.pcd", "c.pcd"}) folder_.write(name, kPcd);
  folder_.write("poses.txt", kTwoKitti);
  expect_error("poses.txt", "found 2 poses, expected 3");
}

TEST_F(ScanFolderDrive, RefusesMorePosesWhenNamesDoNotSayWhich) {
  folder_.write("a.pcd", kPcd);
  folder_.write("poses.txt", kTwoKitti);
  expect_error("poses.txt", "a.pcd is not");
}

TEST_F(ScanFolderDrive, NamesWhatItExpectedInAnUnknownFolder) {
  folder_.write("readme.txt", "nothing here");
  expect_error(folder_.path().string(), "no layout that is known");
  EXPECT_THAT([] { (void)Drive::open("/nowhere/drive"); },
              ThrowsMessage<InputError>(HasSubstr("/nowhere/drive: found nothing")));
  EXPECT_THAT([&] { (void)Drive::open(folder_.path() / "readme.txt"); },
              ThrowsMessage<InputError>(HasSubstr("found a file")));
}

TEST(Drive, RefusesContentsThatDoNotBelongTogether) {
  Drive::Contents contents;
  contents.scan_files = {"a.bin", "b.bin"};
  contents.stamps_ns = {0};
  EXPECT_THROW(Drive{contents}, std::invalid_argument);
  contents.stamps_ns = {0, 1};
  EXPECT_NO_THROW(Drive{contents});
  contents.T_map_lidar = {Eigen::Isometry3d::Identity()};
  EXPECT_THROW(Drive{contents}, std::invalid_argument);
}

TEST_F(ScanFolderDrive, ATrajectoryOfSomeScansGivesPosesToTheseAlone) {
  folder_.write("drive/1624254615500000000.pcd", kPcd);
  folder_.write("drive/1624254615600000000.pcd", kPcd);
  folder_.write("drive/1624254615700000001.pcd", kPcd);
  const Drive drive = Drive::open(folder_.path() / "drive");
  const auto poses_in = [&](const std::string& text) {
    return poses_of_some_scans(drive, folder_.write("some.txt", text));
  };
  const auto some =
      poses_in("1624254615.600000000 1 0 0 0 0 0 1\n1624254615.700000001 2 0 0 0 0 0 1\n");
  ASSERT_TRUE(some);
  ASSERT_EQ(some->size(), 3U);
  EXPECT_FALSE(some->at(0));
  EXPECT_EQ(some->at(1).value().translation().x(), 1.0);
  EXPECT_EQ(some->at(2).value().translation().x(), 2.0);
  // One stamp that is no scan's, a nanosecond off, makes it a path to interpolate; so does a pose
  // for every scan, and KITTI's lines have no stamps.
  EXPECT_FALSE(poses_in("1624254615.599999999 1 0 0 0 0 0 1\n"));
  EXPECT_FALSE(poses_in("1624254615.700000002 2 0 0 0 0 0 1\n"));
  EXPECT_FALSE(
      poses_in("1624254615.5 0 0 0 0 0 0 1\n1624254615.6 1 0 0 0 0 0 1\n"
               "1624254615.700000001 2 0 0 0 0 0 1\n"));
  EXPECT_FALSE(poses_in(kTwoKitti));
}

}  // namespace drive_scan_folder_test
}  // namespace stillmap::maps
