#include <stillmap/mapping/odometry_evaluation.hpp>

#include "evaluation/odometry/treated_scans.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>

#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>

#include "small_drive.hpp"

namespace stillmap::mapping {
namespace odometry_evaluation_test {

/// The small drive with something at its ends and sides: between two walls alone nothing tells how
/// far it went.
struct Street : test::SmallDrive {
  Street() {
    world.boxes.push_back({{35.0, -8.0, 0.0}, {36.0, 8.0, 5.0}});
    world.boxes.push_back({{-26.0, -8.0, 0.0}, {-25.0, 8.0, 5.0}});
    for (const double x : {-18.0, -9.0, 2.0, 15.0, 24.0}) {
      world.boxes.push_back({{x, 6.0, 0.0}, {x + 2.0, 8.0, 4.0}});
      world.boxes.push_back({{x + 4.0, -8.0, 0.0}, {x + 5.5, -6.0, 4.0}});
    }
  }
};

class OdometryEvaluationTest : public ::testing::Test {
 protected:
  OdometryEvaluationTest() : drive_(maps::Drive::open(small_.write(folder_))) {
    options_.loops = false;
    options_.threads = 1;
  }
  [[nodiscard]] OdometryEvaluation evaluate() {
    return evaluate_odometry(drive_, options_, folder_.path(), {}, cancel_);
  }
  [[nodiscard]] std::string refusal() {
    try {
      (void)evaluate();
    } catch (const std::exception& error) {
      return error.what();
    }
    return "nothing";
  }

  test::TemporaryFolder folder_;
  Street small_;
  maps::Drive drive_;
  OdometryEvaluationOptions options_;
  CancelFlag cancel_{false};
};

TEST_F(OdometryEvaluationTest, FollowsADriveAndComparesWithItsPoses) {
  const OdometryEvaluation result = evaluate();
  EXPECT_EQ(result.scans, 4U);
  ASSERT_EQ(result.path.size(), 4U);
  EXPECT_EQ(result.matched + result.partly + result.predicted, 4U);
  EXPECT_EQ(result.odometry.poses, 4U);
  EXPECT_NEAR(result.odometry.way_m, 3.0, 0.01);
  EXPECT_LT(result.odometry.aligned_m.rmse, 0.5);
  EXPECT_TRUE(std::isnan(result.odometry.kitti.translation_percent));
  EXPECT_FALSE(result.corrected);
  EXPECT_FALSE(result.loops);
}

TEST_F(OdometryEvaluationTest, ThePosesOfTheDriveNeverEnterThePath) {
  const OdometryEvaluation own = evaluate();
  for (std::size_t i = 0; i < drive_.size(); ++i)
    options_.reference.emplace_back(test::pose_at(-5.0 * static_cast<double>(i), 1.0, 1.0));
  const OdometryEvaluation other = evaluate();
  for (std::size_t i = 0; i < own.path.size(); ++i)
    EXPECT_TRUE(own.path[i].T_odom_lidar.matrix() == other.path[i].T_odom_lidar.matrix());
  EXPECT_GT(other.odometry.aligned_m.rmse, 3.0);
}

TEST_F(OdometryEvaluationTest, ScansWithoutATruePoseAreFollowedButNotJudged) {
  options_.reference = {small_.T_map_lidar[0], std::nullopt, small_.T_map_lidar[2], std::nullopt};
  const OdometryEvaluation result = evaluate();
  EXPECT_EQ(result.path.size(), 4U);
  EXPECT_EQ(result.odometry.poses, 2U);
  EXPECT_NEAR(result.odometry.way_m, 2.0, 0.01);
  EXPECT_FALSE(result.path[1].T_truth_lidar);
}

TEST_F(OdometryEvaluationTest, NumbersOfScansAreThoseOfTheDrive) {
  options_.selection = maps::Selection::parse("1:4");
  const OdometryEvaluation result = evaluate();
  ASSERT_EQ(result.path.size(), 3U);
  EXPECT_EQ(result.path[0].scan, 1U);
  EXPECT_EQ(result.path[0].stamp_ns, drive_.stamp_ns(1));
  ASSERT_TRUE(result.path[0].T_truth_lidar);
  EXPECT_TRUE(result.path[0].T_truth_lidar->isApprox(drive_.T_map_lidar(1)));
}

TEST_F(OdometryEvaluationTest, JsonHoldsTheKeysOthersBuildOnAndNoNan) {
  const auto json = nlohmann::json::parse(to_json(evaluate()));
  EXPECT_TRUE(json.at("kitti").at("translation_percent").is_null());
  EXPECT_TRUE(json.at("kitti").at("rotation_deg_per_100m").is_null());
  EXPECT_TRUE(json.at("ape_mean_m").is_number());
  EXPECT_TRUE(json.at("ate_rmse_m").is_number());
  EXPECT_TRUE(json.at("rpe").at("translation_percent_10m").is_null());
  EXPECT_TRUE(json.at("rpe").at("rotation_deg_10m").is_null());
  EXPECT_TRUE(json.at("loops").is_null());
  EXPECT_GT(json.at("scans_per_second").get<double>(), 0.0);
  EXPECT_EQ(json.at("scans"), 4);
  EXPECT_TRUE(json.contains("seconds"));
  EXPECT_TRUE(json.contains("options"));
}

TEST_F(OdometryEvaluationTest, ReportHoldsNoScriptAndEscapesNames) {
  OdometryEvaluation result = evaluate();
  const std::string page = to_html(result, {.drive = "a<b", .command = "stillmap & co"});
  EXPECT_THAT(page, testing::HasSubstr("a&lt;b"));
  EXPECT_THAT(page, testing::HasSubstr("stillmap &amp; co"));
  EXPECT_THAT(page, testing::Not(testing::HasSubstr("<script")));
  EXPECT_THAT(page, testing::Not(testing::HasSubstr("nan")));
}

TEST_F(OdometryEvaluationTest, SaysWhatIsMissing) {
  options_.method = "guess";
  EXPECT_THAT(refusal(), testing::HasSubstr("guess"));
  options_.method = "default";
  options_.selection = maps::Selection::parse("::2");
  EXPECT_THAT(refusal(), testing::HasSubstr("step 2"));
  options_.selection = maps::Selection::parse("9:");
  EXPECT_THAT(refusal(), testing::HasSubstr("0 selected scans"));
  options_.selection = {};
  options_.reference.assign(4, std::nullopt);
  EXPECT_THAT(refusal(), testing::HasSubstr("0 of them with a pose"));
}

TEST_F(OdometryEvaluationTest, ADriveWithoutPosesIsRefused) {
  folder_.write("bare/000000.bin", test::bin_of(small_.scan(0)));
  folder_.write("bare/000001.bin", test::bin_of(small_.scan(1)));
  drive_ = maps::Drive::open(folder_.path() / "bare");
  EXPECT_THROW((void)evaluate(), maps::InputError);
  EXPECT_THAT(refusal(), testing::HasSubstr("without poses"));
}

TEST_F(OdometryEvaluationTest, ACancelledOneEnds) {
  cancel_ = true;
  EXPECT_THROW((void)evaluate(), Cancelled);
}

/// The car of the small drive, whose true boxes are given.
class TreatedScansTest : public OdometryEvaluationTest {
 protected:
  [[nodiscard]] maps::PointCloud read(MovablePolicy policy) {
    const std::vector<std::size_t> scans{0, 1, 2, 3};
    const TreatedScans treated(drive_, policy, "boxes:" + small_.write_car(folder_).string(), scans,
                               cancel_);
    (void)treated.read(1);
    maps::PointCloud cloud = treated.read(1).cloud;
    points_ = treated.points();
    return cloud;
  }
  TreatedPoints points_;
};

TEST_F(TreatedScansTest, RawScansAreTheFiles) {
  EXPECT_EQ(read(MovablePolicy::kKeep).positions, drive_.read(1).cloud.positions);
  EXPECT_EQ(points_.projected + points_.deleted, 0U);
}

TEST_F(TreatedScansTest, ProjectedPointsLieAtTheMeanHeightOfTheGround) {
  const maps::PointCloud before = drive_.read(1).cloud;
  const maps::PointCloud cloud = read(MovablePolicy::kProject);
  ASSERT_EQ(cloud.size(), before.size());
  std::size_t moved = 0;
  float height = 0.0F;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (cloud.positions[i] == before.positions[i]) continue;
    if (moved++ == 0) height = cloud.positions[i].z();
    EXPECT_EQ(cloud.positions[i].z(), height);
    EXPECT_EQ(cloud.positions[i].head<2>(), before.positions[i].head<2>());
  }
  EXPECT_EQ(moved, points_.projected);
  EXPECT_GT(moved, 50U);
}

TEST_F(TreatedScansTest, DeletesThePointsThatItWouldProject) {
  (void)read(MovablePolicy::kProject);
  const std::uint64_t projected = points_.projected;
  const maps::PointCloud cloud = read(MovablePolicy::kDelete);
  EXPECT_EQ(points_.deleted, projected);
  EXPECT_EQ(cloud.size() + points_.deleted, points_.in);
}

}  // namespace odometry_evaluation_test
}  // namespace stillmap::mapping
