#include "evaluation/localization/query_scans.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/mapping/map_build.hpp>

#include <algorithm>
#include <cmath>
#include <mutex>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "small_drive.hpp"

namespace stillmap::mapping {
namespace query_scans_test {

/// The small drive, with the true boxes of its car.
class QueryScansTest : public ::testing::Test {
 protected:
  QueryScansTest() : drive_(maps::Drive::open(small_.write(folder_))) {
    options_.query_detector = "boxes:" + small_.write_car(folder_).string();
  }
  [[nodiscard]] maps::PointCloud read(std::size_t scan) {
    return QueryScans(drive_, options_, {0, 1, 2, 3}, cancel_).read(scan, points_);
  }
  /// Points over the foot of the car's box.
  [[nodiscard]] std::size_t in_car(const maps::PointCloud& cloud, std::size_t scan) const {
    const maps::Box car = small_.car_in(scan);
    const Eigen::AngleAxisd turn(-car.yaw_rad, Eigen::Vector3d::UnitZ());
    return static_cast<std::size_t>(
        std::count_if(cloud.positions.begin(), cloud.positions.end(), [&](const auto& p) {
          const Eigen::Vector3d q = turn * (p.template cast<double>() - car.centre);
          return (q.cwiseAbs() - 0.5 * car.size_m).maxCoeff() < 0.05 && q.z() > -0.45;
        }));
  }

  test::TemporaryFolder folder_;
  test::SmallDrive small_;
  maps::Drive drive_;
  LocalizationEvaluationOptions options_;
  QueryPoints points_;
  CancelFlag cancel_{false};
};

TEST_F(QueryScansTest, KeepsEveryPointUnlessToldOtherwise) {
  options_.query_detector = "not asked for";
  const maps::PointCloud cloud = read(1);
  EXPECT_EQ(cloud.size(), small_.scan(1).size());
  EXPECT_GT(in_car(cloud, 1), 50U);
  EXPECT_EQ(points_.in, cloud.size());
  EXPECT_EQ(points_.deleted + points_.projected, 0U);
}

TEST_F(QueryScansTest, AreDeskewedByWhomTheOptionsSay) {
  maps::Drive::Contents contents = drive_.contents();
  contents.spin_start_end_s.assign(test::SmallDrive::kScans, {-0.05, 0.05});
  drive_ = maps::Drive(contents);
  options_.query_deskew = QueryDeskew::kNone;
  const maps::PointCloud recorded = read(1);
  EXPECT_TRUE(recorded.time_offsets_s.empty());
  options_.query_deskew = QueryDeskew::kMap;
  const maps::PointCloud timed = read(1);
  EXPECT_EQ(timed.positions, recorded.positions);
  EXPECT_THAT(timed.time_offsets_s, ::testing::Contains(::testing::Gt(0.04F)));
  options_.query_deskew = QueryDeskew::kVehicle;
  const maps::PointCloud deskewed = read(1);
  EXPECT_NE(deskewed.positions, recorded.positions);
  EXPECT_THAT(deskewed.time_offsets_s, ::testing::Each(0.0F));
}

TEST_F(QueryScansTest, DeletesWhatIsInABoxAndNothingElse) {
  const std::size_t car = in_car(read(1), 1);
  points_ = {};
  options_.query_movable = MovablePolicy::kDelete;
  const maps::PointCloud cloud = read(1);
  EXPECT_EQ(in_car(cloud, 1), 0U);
  EXPECT_GE(points_.deleted, car);
  EXPECT_EQ(points_.in, small_.scan(1).size());
  EXPECT_EQ(cloud.size() + points_.deleted, points_.in);
  // The world holds nothing else that stands within a box's margins.
  EXPECT_LT(points_.deleted, car + car / 4);
}

TEST_F(QueryScansTest, PutsThemOntoTheScansOwnGround) {
  options_.query_movable = MovablePolicy::kProject;
  const maps::PointCloud cloud = read(1);
  EXPECT_EQ(in_car(cloud, 1), 0U);
  EXPECT_EQ(cloud.size(), points_.in - points_.without_ground);
  EXPECT_EQ(points_.without_ground, points_.deleted);
  ASSERT_GT(points_.projected, 50U);
  // Ground is flat at zero in this world.
  const maps::PointCloud before = small_.scan(1);
  ASSERT_EQ(cloud.size(), before.size());
  std::size_t moved = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if ((cloud.positions[i] - before.positions[i]).norm() < 1e-5F) continue;
    ++moved;
    const double z = (small_.T_map_lidar[1] * cloud.positions[i].cast<double>()).z();
    EXPECT_NEAR(z, 0.0, 0.03);
    EXPECT_LT((cloud.positions[i] - before.positions[i]).head<2>().norm(), 1e-4F);
  }
  EXPECT_EQ(moved, points_.projected);
}

TEST_F(QueryScansTest, RefusesADetectorThatIsNotThere) {
  options_.query_movable = MovablePolicy::kDelete;
  options_.query_detector = "magic";
  EXPECT_THROW((void)read(0), std::invalid_argument);
}

TEST_F(QueryScansTest, EndsWhenCancelled) {
  options_.query_movable = MovablePolicy::kDelete;
  cancel_ = true;
  EXPECT_THROW((void)read(0), Cancelled);
}

/// Counts the points that it is asked with; always lost.
class Counting : public localization::Aligner {
 public:
  explicit Counting(std::size_t& points) : points_(points) {}
  [[nodiscard]] localization::AlignmentResult align(
      const maps::PointCloud& scan_lidar,
      const std::optional<localization::Prior>& /*prior*/) const override {
    const std::lock_guard lock(mutex_);
    points_ += scan_lidar.size();
    return {};
  }

 private:
  mutable std::mutex mutex_;
  std::size_t& points_;
};

TEST_F(QueryScansTest, AreWhatAMethodIsAskedWith) {
  (void)build_map({drive_.contents().root}, folder_.path() / "map", MapBuildOptions(), {}, cancel_);
  options_.query_movable = MovablePolicy::kDelete;
  std::string first;
  for (const int threads : {1, 3}) {
    options_.threads = threads;
    std::size_t asked = 0;
    const LocalizationEvaluation result = evaluate_localization(
        *maps::MapPackage::open(folder_.path() / "map"), drive_, options_,
        [&](const maps::MapPackage&) { return std::make_unique<Counting>(asked); }, {}, cancel_);
    EXPECT_GT(result.points.deleted, 0U);
    EXPECT_EQ(asked, result.points.in - result.points.deleted);
    const nlohmann::json json = nlohmann::json::parse(to_json(result));
    EXPECT_EQ(json["points"]["deleted"], result.points.deleted);
    EXPECT_EQ(json["options"]["query_movable"], "delete");
    EXPECT_EQ(json["options"]["query_detector"], options_.query_detector);
    if (first.empty()) first = json["points"].dump();
    EXPECT_EQ(json["points"].dump(), first);
  }
}

}  // namespace query_scans_test
}  // namespace stillmap::mapping
