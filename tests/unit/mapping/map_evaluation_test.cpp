#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/mapping/ground.hpp>
#include <stillmap/mapping/map_build.hpp>
#include <stillmap/mapping/map_evaluation.hpp>
#include <stillmap/maps/error.hpp>

#include <nlohmann/json.hpp>

#include "small_drive.hpp"
#include "support/throws.hpp"

namespace stillmap::mapping {
namespace map_evaluation_test {

using maps::InputError;
using test::ThrowsSaying;

class EvaluateMap : public ::testing::Test {
 protected:
  EvaluateMap() : drive_(small_.write(folder_)), boxes_(small_.write_car(folder_)) {}

  void build(MovablePolicy policy) {
    MapBuildOptions options;
    options.detector = "boxes:" + boxes_.string();
    options.projection.policy = policy;
    options.selection = selection_;
    options.given_poses = GivenPosesUse::kExact;
    (void)build_map({drive_}, folder_.path() / "map", options, {}, cancel_);
  }
  [[nodiscard]] MapEvaluation evaluate() const {
    return evaluate_map(*maps::MapPackage::open(folder_.path() / "map"), maps::Drive::open(drive_),
                        {boxes_, pictures_}, {}, cancel_);
  }

  test::TemporaryFolder folder_;
  test::SmallDrive small_;
  std::filesystem::path drive_;
  std::filesystem::path boxes_;
  maps::Selection selection_;
  std::optional<std::filesystem::path> pictures_;
  CancelFlag cancel_{false};
};

TEST_F(EvaluateMap, FindsNothingRemovedAndNothingChangedInAMapThatKeepsAll) {
  build(MovablePolicy::kKeep);
  const MapEvaluation result = evaluate();
  EXPECT_EQ(result.scans, 4U);
  EXPECT_GT(result.box_points_before, 100U);
  EXPECT_EQ(result.box_points_after, result.box_points_before);
  EXPECT_GT(result.outside_points, 10000U);
  EXPECT_EQ(result.outside_changed, 0U);
  EXPECT_EQ(result.fov_changed, 0U);
  EXPECT_GT(result.fov_points, result.outside_points / 8);
  EXPECT_LT(result.fov_points, result.outside_points / 2);
}

TEST_F(EvaluateMap, FindsAllLabelledPointsRemovedInAMapOfTheLabels) {
  build(MovablePolicy::kProject);
  const MapEvaluation result = evaluate();
  std::size_t by_hand = 0;
  for (std::size_t i = 0; i < test::SmallDrive::kScans; ++i) {
    // The ground is flat at z = -1.8 m in the lidar frame.
    for (const Eigen::Vector3f& p : small_.scan(i).positions)
      by_hand += small_.car_in(i).contains(p.cast<double>()) && p.z() > -1.5F ? 1 : 0;
  }
  // Points on the car's faces lie on the box's; rounding and the found ground decide on some.
  EXPECT_NEAR(static_cast<double>(result.box_points_before), static_cast<double>(by_hand),
              0.05 * static_cast<double>(by_hand));
  EXPECT_EQ(result.box_points_after, 0U);
  EXPECT_EQ(result.box_points_in_map, 0U);
  EXPECT_EQ(result.outside_changed, 0U);
  const auto json = nlohmann::json::parse(to_json(result));
  EXPECT_DOUBLE_EQ(json["box_points"]["removed_share"], 1.0);
  EXPECT_DOUBLE_EQ(json["outside"]["changed_share"], 0.0);
}

TEST_F(EvaluateMap, CountsAPointThatABoxBeyondTheLabelsTook) {
  // The build sees a box over the wall on the left that the labels do not have.
  maps::BoxSequence more;
  maps::Box wall = small_.car_in(0);
  wall.centre = {5.0, 8.0, -0.8};
  wall.size_m = {4.0, 1.0, 1.0};
  wall.track = 2;
  maps::Box car = small_.car_in(0);
  car.track = 1;
  more.by_scan[0] = {car, wall};
  const std::filesystem::path labels = boxes_;
  boxes_ = folder_.path() / "more.json";
  maps::write_boxes(boxes_, more);
  selection_ = maps::Selection::parse("0:1");
  build(MovablePolicy::kProject);
  boxes_ = labels;
  const MapEvaluation result = evaluate();
  EXPECT_EQ(result.scans, 1U);
  EXPECT_EQ(result.box_points_after, 0U);
  // A build takes a box as reaching from the ground to a margin over it.
  maps::Box grown = wall;
  grown.size_m = {4.2, 1.2, 1.7};
  grown.centre.z() = -0.9;
  std::size_t in_wall = 0;
  for (const Eigen::Vector3f& p : small_.scan(0).positions)
    in_wall += grown.contains(p.cast<double>()) ? 1 : 0;
  EXPECT_GT(in_wall, 20U);
  EXPECT_NEAR(static_cast<double>(result.outside_changed), static_cast<double>(in_wall),
              0.1 * static_cast<double>(in_wall));
}

TEST_F(EvaluateMap, WritesSharesByHand) {
  MapEvaluation result;
  result.scans = 3;
  result.box_points_before = 200;
  result.box_points_after = 50;
  result.box_points_in_map = 80;
  result.outside_points = 1000;
  result.outside_changed = 20;
  result.fov_points = 400;
  result.fov_changed = 2;
  const auto json = nlohmann::json::parse(to_json(result));
  EXPECT_EQ(json["scans"], 3);
  EXPECT_DOUBLE_EQ(json["box_points"]["removed_share"], 0.75);
  EXPECT_DOUBLE_EQ(json["box_points"]["in_map_removed_share"], 0.6);
  EXPECT_DOUBLE_EQ(json["outside"]["changed_share"], 0.02);
  EXPECT_DOUBLE_EQ(json["outside"]["fov_changed_share"], 0.005);
}

TEST_F(EvaluateMap, DrawsBeforeAndAfter) {
  build(MovablePolicy::kProject);
  pictures_ = folder_.path() / "pictures";
  (void)evaluate();
  EXPECT_TRUE(std::filesystem::exists(*pictures_ / "before.png"));
  EXPECT_TRUE(std::filesystem::exists(*pictures_ / "after.png"));
}

TEST_F(EvaluateMap, RefusesAnotherDrive) {
  build(MovablePolicy::kProject);
  std::filesystem::remove(drive_ / "000003.bin");
  EXPECT_THAT([&] { (void)evaluate(); }, ThrowsSaying<InputError>({drive_.string(), "3 scans"}));
}

TEST_F(EvaluateMap, RefusesADriveOfOtherTimes) {
  build(MovablePolicy::kProject);
  std::string tum;
  for (int i = 0; i < 4; ++i) tum += fmt::format("{} {} 0 1.8 0 0 0 1\n", 500.0 + 0.1 * i, i);
  std::filesystem::remove(drive_ / "poses.txt");
  folder_.write("drive/poses.tum", tum);
  EXPECT_THAT([&] { (void)evaluate(); }, ThrowsSaying<InputError>({drive_.string(), "scan 0"}));
}

TEST_F(EvaluateMap, RefusesLabelsOfOtherScans) {
  maps::BoxSequence boxes;
  boxes.by_scan[1] = {small_.car_in(1)};
  maps::write_boxes(boxes_, boxes);
  selection_ = maps::Selection::parse("::2");
  build(MovablePolicy::kProject);
  EXPECT_THAT([&] { (void)evaluate(); }, ThrowsSaying<InputError>({boxes_.string(), "no label"}));
}

TEST_F(EvaluateMap, HasNoShareOfNothing) {
  const auto json = nlohmann::json::parse(to_json(MapEvaluation{}));
  EXPECT_TRUE(json["box_points"]["removed_share"].is_null());
  EXPECT_TRUE(json["box_points"]["in_map_removed_share"].is_null());
  EXPECT_TRUE(json["outside"]["changed_share"].is_null());
}

TEST_F(EvaluateMap, EndsWhenCancelled) {
  build(MovablePolicy::kProject);
  cancel_ = true;
  EXPECT_THROW((void)evaluate(), Cancelled);
}

}  // namespace map_evaluation_test
}  // namespace stillmap::mapping
