#include <stillmap/mapping/odometry_table.hpp>

#include "evaluation/odometry/run_json.hpp"
#include "evaluation/odometry/table_differences.hpp"
#include "evaluation/odometry/table_pieces.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>

#include "small_drive.hpp"

namespace stillmap::mapping {
namespace odometry_table_test {

OdometryTableRun run(const std::string& drive, MovablePolicy points, double ape_m,
                     double with_loops_m = 0.1) {
  OdometryTableRun run;
  run.drive = drive;
  run.scans = 10;
  run.method = "default";
  run.points = points;
  run.without_loops.ape_mean_m = ape_m;
  run.without_loops.percent_10m = 0.5;
  run.with_loops.ape_mean_m = with_loops_m;
  return run;
}

TEST(OdometryTable, DifferencesAreOfTheSameDrives) {
  // Projected less raw: -0.1, +0.1, +0.3 m; a drive that was not projected does not count.
  const auto differences =
      differences_of({run("a", MovablePolicy::kKeep, 1.0), run("a", MovablePolicy::kProject, 0.9),
                      run("b", MovablePolicy::kKeep, 2.0), run("b", MovablePolicy::kProject, 2.1),
                      run("c", MovablePolicy::kKeep, 3.0), run("c", MovablePolicy::kProject, 3.3),
                      run("d", MovablePolicy::kKeep, 9.0)});
  ASSERT_EQ(differences.size(), 4U);
  const OdometryTableDifference& projected = differences[0];
  EXPECT_EQ(projected.points, MovablePolicy::kProject);
  EXPECT_FALSE(projected.loops);
  EXPECT_EQ(projected.drives, 3U);
  EXPECT_EQ(projected.better, 1U);
  EXPECT_NEAR(projected.ape_mean_m.value, 0.1, 1e-12);
  // Standard error 0.2 / sqrt(3), Student's t of 2 degrees of freedom 4.303.
  EXPECT_NEAR(projected.ape_mean_m.high - 0.1, 4.303 * 0.2 / std::sqrt(3.0), 2e-3);
  EXPECT_NEAR(projected.percent_10m.value, 0.0, 1e-12);
  EXPECT_EQ(differences[1].drives, 0U);
  EXPECT_TRUE(std::isnan(differences[1].ape_mean_m.value));
  EXPECT_TRUE(differences[2].loops);
}

TEST(OdometryTable, OneDriveHasNoInterval) {
  const Interval one = mean_interval({0.3});
  EXPECT_DOUBLE_EQ(one.value, 0.3);
  EXPECT_TRUE(std::isnan(one.low));
  EXPECT_TRUE(std::isnan(mean_interval({}).value));
}

TEST(OdometryTable, ARunIsReadAsItWasWritten) {
  const test::TemporaryFolder folder;
  OdometryTableRun before = run("seed 7", MovablePolicy::kDelete, 1.25);
  before.without_loops.kitti_percent = std::numeric_limits<double>::quiet_NaN();
  before.loops_found = 5;
  before.loops_right = 4;
  before.treated = {.in = 9, .projected = 0, .deleted = 3};
  const RunPiece piece{.file = folder.path() / "run.json", .key = "k"};
  write_run(piece, before);
  const auto after = read_run(piece);
  ASSERT_TRUE(after);
  EXPECT_EQ(after->drive, "seed 7");
  EXPECT_EQ(after->points, MovablePolicy::kDelete);
  EXPECT_EQ(after->without_loops.ape_mean_m, 1.25);
  EXPECT_TRUE(std::isnan(after->without_loops.kitti_percent));
  EXPECT_EQ(after->loops_right, 4U);
  EXPECT_EQ(after->treated.deleted, 3U);
  EXPECT_EQ(run_json(*after).dump(), run_json(before).dump());
  EXPECT_FALSE(read_run({.file = piece.file, .key = "other"}));
  folder.write("run.json", "{ broken");
  EXPECT_FALSE(read_run(piece));
}

/// A KITTI odometry folder of the small drive under several numbers.
class KittiFolderTest : public ::testing::Test {
 protected:
  KittiFolderTest() { options_.kitti = folder_.path(); }
  void write_sequence(const std::string& name, bool poses = true) const {
    std::string lines;
    for (std::size_t i = 0; i < test::SmallDrive::kScans; ++i) {
      folder_.write(fmt::format("sequences/{}/velodyne/{:06}.bin", name, i),
                    test::bin_of(small_.scan(i)));
      lines += test::kitti_line(small_.T_map_lidar[i]);
    }
    folder_.write("sequences/" + name + "/calib.txt", "Tr: 1 0 0 0 0 1 0 0 0 0 1 0\n");
    if (poses) folder_.write("poses/" + name + ".txt", lines);
  }
  test::TemporaryFolder folder_;
  test::SmallDrive small_;
  OdometryTableOptions options_;
};

TEST_F(KittiFolderTest, TakesThePapersSequencesThatAreThere) {
  write_sequence("05");
  write_sequence("08");
  write_sequence("01");
  std::vector<std::string> missing;
  const std::vector<TableDrive> drives = kitti_drives(options_, missing);
  ASSERT_EQ(drives.size(), 2U);
  EXPECT_EQ(drives[0].name, "KITTI 05");
  EXPECT_EQ(drives[1].name, "KITTI 08");
  ASSERT_TRUE(drives[1].paper_m);
  EXPECT_EQ(drives[1].paper_m->at(1), 5.97);
  EXPECT_THAT(missing, testing::ElementsAre("00", "07"));
}

TEST_F(KittiFolderTest, TakesTheSequencesThatAreAskedFor) {
  write_sequence("01");
  options_.sequences = {"01"};
  std::vector<std::string> missing;
  const std::vector<TableDrive> drives = kitti_drives(options_, missing);
  ASSERT_EQ(drives.size(), 1U);
  EXPECT_FALSE(drives[0].paper_m);
  EXPECT_TRUE(missing.empty());
  options_.sequences = {"01", "02"};
  EXPECT_THROW((void)kitti_drives(options_, missing), maps::InputError);
}

TEST_F(KittiFolderTest, SaysWhichLayoutIsExpected) {
  write_sequence("05", false);
  std::vector<std::string> missing;
  options_.sequences = {"05"};
  try {
    (void)kitti_drives(options_, missing);
    FAIL();
  } catch (const maps::InputError& error) {
    EXPECT_THAT(std::string(error.what()), testing::HasSubstr("no poses/05.txt"));
    EXPECT_THAT(std::string(error.what()), testing::HasSubstr("sequences/NN/velodyne"));
  }
  options_.sequences = {};
  EXPECT_THROW((void)kitti_drives(options_, missing), maps::InputError);
}

TEST_F(KittiFolderTest, ATableIsMadeOnceAndReadFromItsPieces) {
  write_sequence("07");
  options_.methods = {"default"};
  options_.detector = "geometric";
  options_.threads = 1;
  const CancelFlag cancel{false};
  const std::filesystem::path work = folder_.path() / "work";
  std::size_t steps = 0;
  const auto count = [&](std::string_view, std::size_t, std::size_t) { ++steps; };
  const OdometryTable table = evaluate_odometry_table(options_, {}, work, true, count, cancel);
  ASSERT_EQ(table.runs.size(), 3U);
  ASSERT_EQ(table.drives.size(), 1U);
  EXPECT_EQ(table.drives[0].scans, 4U);
  EXPECT_GT(steps, 0U);
  steps = 0;
  const OdometryTable again = evaluate_odometry_table(options_, {}, work, true, count, cancel);
  EXPECT_EQ(steps, 0U);
  ASSERT_EQ(again.runs.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_EQ(run_json(again.runs[i]).dump(), run_json(table.runs[i]).dump());
  const auto json = nlohmann::json::parse(to_json(table));
  EXPECT_EQ(json.at("table").size(), 3U);
  EXPECT_EQ(json.at("drives").at(0).at("paper_m").at("without_removal"), 1.55);
  EXPECT_TRUE(
      json.at("table").at(0).at("without_loops").at("kitti").at("translation_percent").is_null());
  EXPECT_THAT(to_html(table, "c"), testing::Not(testing::HasSubstr("nan")));
}

TEST(OdometryTableOptions, NamesEveryBrokenBound) {
  OdometryTableOptions options;
  EXPECT_TRUE(options.violations().empty());
  options.seeds = {1, 1};
  options.scans = 3;
  options.methods = {"guess"};
  options.threads = -1;
  EXPECT_EQ(options.violations().size(), 4U);
}

}  // namespace odometry_table_test
}  // namespace stillmap::mapping
