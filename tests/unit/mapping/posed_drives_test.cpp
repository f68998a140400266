#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/geodesy.hpp>

#include <string>

#include "pipeline/opened_drives.hpp"
#include "pipeline/posed_drives_bytes.hpp"
#include "pipeline/poses_stage.hpp"
#include "pipeline/survey_stage.hpp"
#include "small_drive.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"
#include "trajectory/drive_of_map.hpp"

namespace stillmap::mapping {
namespace posed_drives_test {

using maps::InputError;
using test::ThrowsSaying;

class PosedDrivesTest : public ::testing::Test {
 protected:
  PosedDrivesTest() : drive_(maps::Drive::open(test::SmallDrive().write(folder_))) {}
  [[nodiscard]] maps::Drive without_poses() const {
    maps::Drive::Contents contents = drive_.contents();
    contents.T_map_lidar.clear();
    return maps::Drive(contents);
  }
  [[nodiscard]] maps::Drive at(const maps::GeodeticOrigin& origin) const {
    return drive_.with_poses(drive_.contents().T_map_lidar, origin);
  }

  test::TemporaryFolder folder_;
  maps::Drive drive_;
  MapBuildOptions options_;
};

TEST_F(PosedDrivesTest, GivenPosesAreTakenWhereThereAreSome) {
  EXPECT_EQ(odometry_of({drive_}, options_), "given");
  EXPECT_EQ(odometry_of({drive_, without_poses()}, options_), "default");
  options_.trajectory.gnss_sigma_m = 0.5;
  EXPECT_EQ(odometry_of({drive_}, options_), "default") << "who doubts them wants better ones";
}

TEST_F(PosedDrivesTest, ContradictionsAreRefusedInWords) {
  options_.odometry = "magic";
  EXPECT_THAT([&] { (void)odometry_of({drive_}, options_); },
              ThrowsSaying<std::invalid_argument>({"magic", "given", "default", "loam"}));
  options_.odometry = "given";
  EXPECT_THAT([&] { (void)odometry_of({without_poses()}, options_); },
              ThrowsSaying<InputError>({"drive", "without poses"}));
  options_.trajectory.prior = {.sigma_m = 1.0, .sigma_rad = 0.1};
  EXPECT_THAT([&] { (void)odometry_of({drive_}, options_); },
              ThrowsSaying<std::invalid_argument>({"given", "prior"}));
}

TEST_F(PosedDrivesTest, OriginsAreBroughtTogetherByGeodesy) {
  // A hundred-thousandth of a degree of latitude is 1.11 m to the north.
  const maps::GeodeticOrigin first{49.0, 8.0, 110.0}, second{49.00001, 8.0, 112.0};
  const std::vector<maps::Drive> posed = in_one_frame({at(first), at(second)});
  for (std::size_t i = 0; i < drive_.size(); ++i) {
    const Eigen::Vector3d way =
        posed[1].T_map_lidar(i).translation() - posed[0].T_map_lidar(i).translation();
    EXPECT_NEAR((way - Eigen::Vector3d(0.0, 1.112, 2.0)).norm(), 0.0, 2e-3) << i;
  }
  EXPECT_DOUBLE_EQ(posed[1].contents().origin->latitude_deg, 49.0);
  EXPECT_THAT(
      [&] {
        (void)in_one_frame({at(first), drive_});
      },
      ThrowsSaying<InputError>({"without a geodetic origin"}));
}

TEST(Geodesy, ThereAndBackIsNowhere) {
  const maps::GeodeticOrigin a{49.0, 8.0, 110.0}, b{49.02, 8.03, 150.0};
  const Eigen::Isometry3d T = maps::T_enu_enu(a, b) * maps::T_enu_enu(b, a);
  EXPECT_LT((T.matrix() - Eigen::Matrix4d::Identity()).norm(), 1e-9);
  // Up there leans away from up here by the angle between the two places.
  const Eigen::Vector3d up = maps::T_enu_enu(a, b).linear().col(2);
  EXPECT_NEAR(std::acos(up.z()) * 6.378e6, maps::T_enu_enu(a, b).translation().head<2>().norm(),
              20.0);
}

TEST_F(PosedDrivesTest, PosesOfAnotherNumberOfScansAreRefused) {
  std::vector<Eigen::Isometry3d> poses = drive_.contents().T_map_lidar;
  poses.pop_back();
  EXPECT_THROW((void)drive_.with_poses(poses, std::nullopt), std::invalid_argument);
  poses.resize(drive_.size(), Eigen::Isometry3d::Identity());
  poses[1].translation().x() = std::nan("");
  EXPECT_THROW((void)drive_.with_poses(poses, std::nullopt), std::invalid_argument);
}

TEST_F(PosedDrivesTest, ViewsOfTheScansKeepWhatIsDoubtedOfTheirPoses) {
  std::vector<std::vector<maps::PoseDisagreement>> doubts(1);
  doubts.front().resize(drive_.size());
  doubts.front()[1].m = 0.25F;
  const DriveSet drives({drive_}, options_, doubts);
  const Survey survey(folder_.path());
  const Eigen::Vector3d origin(3.0, -2.0, 1.0);
  const PosedViews posed = posed_views(drives, survey, origin);
  ASSERT_EQ(posed.doubts.size(), drives.size());
  EXPECT_EQ(posed.doubts[1].m, 0.25F);
  ASSERT_EQ(posed.T_local_lidar.size(), drives.size());
  EXPECT_LT(
      (posed.T_local_lidar[1].translation() + origin - drives.T_map_scan(1).translation()).norm(),
      1e-12);
}

class PosedDrivesBytes : public PosedDrivesTest {
 protected:
  PosedDrivesBytes() {
    posed_.drives = {at({49.0, 8.0, 110.0}), drive_};
    posed_.counts = {{"key_frames", 7}, {"loops_found", 0}};
    GivenPosesResult given;
    given.use = GivenPosesUse::kExact;
    given.errors.by_way = {{.way_m = 0.0, .pairs = 3, .median_m = 0.02, .max_rad = 0.5}};
    given.errors.denied = 2;
    given.moved.max_m = 0.25;
    posed_.given = given;
    posed_.notes.assign(2, std::vector<ScanNote>(drive_.size(), ScanNote::kNone));
    posed_.notes[1][2] = ScanNote::kHidden;
    posed_.faults = {{"pose_clock", "apart", "shift"}, {"pose_scale", "feet", ""}};
    posed_.graph = DriveGraph{.key_frames = {{0, 0}, {1, 1}}, .loops = {{{1, 1}, {0, 0}, 0.75}}};
  }
  PosedDrives posed_;
};

TEST_F(PosedDrivesBytes, ComeBackToTheLastBit) {
  const PosedDrives back = posed_drives_from(to_bytes(posed_), {without_poses(), without_poses()});
  EXPECT_EQ(back.counts, posed_.counts);
  EXPECT_EQ(back.notes, posed_.notes);
  ASSERT_TRUE(back.graph);
  ASSERT_EQ(back.graph->key_frames.size(), 2U);
  EXPECT_EQ(back.graph->key_frames[1].drive, 1U);
  EXPECT_EQ(back.graph->key_frames[1].index, 1U);
  ASSERT_EQ(back.graph->loops.size(), 1U);
  EXPECT_EQ(back.graph->loops[0].from.drive, 1U);
  EXPECT_EQ(back.graph->loops[0].to.drive, 0U);
  EXPECT_EQ(back.graph->loops[0].weight, 0.75);
  ASSERT_TRUE(back.given);
  EXPECT_EQ(back.given->use, GivenPosesUse::kExact);
  ASSERT_EQ(back.given->errors.by_way.size(), 1U);
  EXPECT_EQ(back.given->errors.by_way[0].pairs, 3U);
  EXPECT_EQ(back.given->errors.by_way[0].median_m, 0.02);
  EXPECT_EQ(back.given->errors.by_way[0].max_rad, 0.5);
  EXPECT_EQ(back.given->errors.denied, 2U);
  EXPECT_EQ(back.given->moved.max_m, 0.25);
  ASSERT_EQ(back.faults.size(), 2U);
  EXPECT_EQ(back.faults[0].remedy, "shift");
  EXPECT_EQ(back.faults[1].code, "pose_scale");
  for (std::size_t d = 0; d < 2; ++d) {
    ASSERT_EQ(back.drives[d].contents().origin.has_value(), d == 0);
    for (std::size_t i = 0; i < drive_.size(); ++i)
      EXPECT_EQ(back.drives[d].T_map_lidar(i).matrix(), posed_.drives[d].T_map_lidar(i).matrix());
  }
  EXPECT_DOUBLE_EQ(back.drives[0].contents().origin->altitude_m, 110.0);
}

TEST_F(PosedDrivesBytes, OfAnotherLengthAreRefused) {
  const std::string bytes = to_bytes(posed_);
  for (std::size_t size = 0; size < bytes.size(); ++size)
    EXPECT_THROW((void)posed_drives_from(bytes.substr(0, size), posed_.drives),
                 std::invalid_argument)
        << size;
  EXPECT_THROW((void)posed_drives_from(bytes + "x", posed_.drives), std::invalid_argument);
  EXPECT_THROW((void)posed_drives_from(bytes, {drive_}), std::invalid_argument);
}

TEST_F(PosedDrivesBytes, OfScansThatAreNotThereAreRefused) {
  posed_.graph->loops[0].to.index = drive_.size();
  EXPECT_THROW((void)posed_drives_from(to_bytes(posed_), posed_.drives), std::invalid_argument);
  posed_.graph.reset();
  EXPECT_FALSE(posed_drives_from(to_bytes(posed_), posed_.drives).graph);
}

/// The drive where a map has it.
class OnPath : public PosedDrivesTest {
 protected:
  /// The drive's scans 0 and 2, a metre to the side of where its own poses are.
  [[nodiscard]] maps::Trajectory path() const {
    std::vector<maps::StampedPose> poses;
    for (const std::size_t scan : {0U, 2U}) poses.push_back({drive_.stamp_ns(scan), aside(scan)});
    return maps::Trajectory(poses);
  }
  [[nodiscard]] Eigen::Isometry3d aside(std::size_t scan) const {
    return Eigen::Translation3d(0.0, 1.0, 0.0) * drive_.T_map_lidar(scan);
  }
  static double apart_m(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
    return (a.translation() - b.translation()).norm();
  }
};

TEST_F(OnPath, ScansBetweenAndBehindFollow) {
  const maps::Drive found = on_path(drive_, path());
  for (const std::size_t scan : {0U, 2U})
    EXPECT_EQ(found.T_map_lidar(scan).matrix(), aside(scan).matrix());
  // By its own motion, which the path keeps; a straight line by time would be off by millimetres.
  EXPECT_LT(apart_m(found.T_map_lidar(1), aside(1)), 1e-9);
  EXPECT_LT(apart_m(found.T_map_lidar(3), aside(3)), 0.02);
}

TEST_F(OnPath, AScanBetweenPosesThatWereMovedLiesThereByItsTime) {
  std::vector<maps::StampedPose> poses = path().poses();
  poses.back().T_map_lidar.pretranslate(Eigen::Vector3d(0.0, 0.2, 0.0));
  const maps::Trajectory moved(poses);
  EXPECT_LT(apart_m(on_path(drive_, moved).T_map_lidar(1), moved.at(drive_.stamp_ns(1)).value()),
            1e-9);
}

// Every third scan is in the map: poses 0, 1, 2, ... are scans 0, 3, 6, ...
TEST_F(PosedDrivesTest, GraphSpeaksOfThePosesOfTheMap) {
  options_.selection.step = 3;
  ASSERT_EQ(drive_.size(), 4U);
  const DriveSet drives({drive_, drive_}, options_);
  constexpr std::size_t each = 2;
  const DriveGraph graph{.key_frames = {{1, 0}, {0, 0}, {0, 1}, {0, 2}},
                         .loops = {{{1, 2}, {0, 0}, 0.5}}};
  const maps::MapGraph found = map_graph_of(drives, graph);
  EXPECT_THAT(found.key_frames, ::testing::ElementsAre(0U, 1U, each));
  ASSERT_EQ(found.loops.size(), 1U);
  EXPECT_EQ(found.loops[0], (maps::MapGraph::Loop{.from = each + 1, .to = 0, .weight = 0.5}));
}

}  // namespace posed_drives_test
}  // namespace stillmap::mapping
