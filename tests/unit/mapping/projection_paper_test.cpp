#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/mapping/projection.hpp>

#include <numbers>

#include "support/throws.hpp"

/// What "as the paper does" means: its text, where the printed equations say something else.
namespace stillmap::mapping {
namespace projection_paper_test {

using test::ThrowsSaying;
using ::testing::Each;
using ::testing::ElementsAre;

/// Must not be asked under `GroundHeight::kMean`.
class Nowhere final : public GroundBelow {
 public:
  [[nodiscard]] std::optional<Foot> below(const Eigen::Vector3f& /*p*/) const override {
    ADD_FAILURE() << "the mean needs no surface";
    return std::nullopt;
  }
};

ProjectionResult project(const std::vector<Eigen::Vector3f>& points,
                         const std::vector<std::uint8_t>& is_ground, const maps::Box& box) {
  maps::PointCloud cloud;
  cloud.positions = points;
  ProjectionOptions options;
  options.ground_height = GroundHeight::kMean;
  options.margin_m = 1.0;
  options.margin_up_m = 1.0;
  const std::vector<MovableBox> boxes = {{box, 20.0}};
  return project_objects(cloud, is_ground, Nowhere(), boxes, options);
}

const maps::Box kLong = {.centre = {10.0, 0.0, 0.0}, .size_m = {6.0, 2.0, 2.0}, .yaw_rad = 0.0};

TEST(PaperProjection, Equation5HasTheLengthAlongTheHeadingAndNotTheWidth) {
  const auto result =
      project({{12.5F, 0.0F, 0.5F}, {10.0F, 2.5F, 0.5F}, {5.0F, 0.0F, -2.0F}}, {0, 0, 1}, kLong);
  EXPECT_THAT(result.fates,
              ElementsAre(PointFate::kProjected, PointFate::kKept, PointFate::kGround));
}

TEST(PaperProjection, Equation7TurnsTheBoxAboutItsCentreAndNotAboutTheSensor) {
  maps::Box box = kLong;
  box.yaw_rad = 0.5 * std::numbers::pi;
  // Vertices turned about the sensor would be around (0, 10).
  const auto result =
      project({{10.0F, 2.5F, 0.5F}, {12.5F, 0.0F, 0.5F}, {0.0F, 10.0F, 0.5F}, {5.0F, 0.0F, -2.0F}},
              {0, 0, 0, 1}, box);
  EXPECT_THAT(result.fates, ElementsAre(PointFate::kProjected, PointFate::kKept, PointFate::kKept,
                                        PointFate::kGround));
}

TEST(PaperProjection, Equation10IsTheMeanHeightOfTheGroundPoints) {
  const std::vector<Eigen::Vector3f> points = {
      {10.0F, 0.0F, 0.5F}, {5.0F, 1.0F, -2.0F}, {-3.0F, 7.0F, -1.0F}, {20.0F, 0.0F, -1.5F}};
  const auto result = project(points, {0, 1, 1, 1}, kLong);
  EXPECT_EQ(result.positions[0], Eigen::Vector3f(10.0F, 0.0F, -1.5F));
}

TEST(PaperProjection, Equation11FlattensPointsInBoxesAndNotEveryPointAboveGround) {
  const std::vector<Eigen::Vector3f> points = {
      {10.0F, 0.0F, 0.5F}, {30.0F, 5.0F, 4.0F}, {5.0F, 0.0F, -2.0F}};
  const auto result = project(points, {0, 0, 1}, kLong);
  EXPECT_THAT(result.fates,
              ElementsAre(PointFate::kProjected, PointFate::kKept, PointFate::kGround));
  EXPECT_EQ(result.positions[1], points[1]);
  EXPECT_EQ(result.positions[2], points[2]);
}

TEST(PaperProjection, HasNoMargins) {
  const auto result = project({{13.1F, 0.0F, 0.0F},
                               {10.0F, 1.1F, 0.0F},
                               {10.0F, 0.0F, 1.1F},
                               {10.0F, 0.0F, -1.1F},
                               {5.0F, 0.0F, -2.0F}},
                              {0, 0, 0, 0, 1}, kLong);
  EXPECT_EQ(result.kept, 4U);
}

TEST(PaperProjection, LeavesGroundInABoxWhereItIs) {
  const std::vector<Eigen::Vector3f> points = {{10.0F, 0.0F, 0.5F}, {5.0F, 0.0F, -2.0F}};
  const auto result = project(points, {1, 1}, kLong);
  EXPECT_THAT(result.fates, Each(PointFate::kGround));
  EXPECT_EQ(result.positions, points);
}

TEST(PaperProjection, DropsAndCountsPointsOfAScanWithoutGround) {
  const auto result = project({{10.0F, 0.0F, 0.5F}, {20.0F, 0.0F, 0.5F}}, {0, 0}, kLong);
  EXPECT_THAT(result.fates, ElementsAre(PointFate::kDeleted, PointFate::kKept));
  EXPECT_EQ(result.without_ground, 1U);
}

TEST(GroundHeight, HasANameThatReadsBack) {
  EXPECT_EQ(ground_height_from("local"), GroundHeight::kLocal);
  EXPECT_EQ(ground_height_from("mean"), GroundHeight::kMean);
  EXPECT_EQ(name_of(GroundHeight::kLocal), "local");
  EXPECT_EQ(name_of(GroundHeight::kMean), "mean");
  EXPECT_THAT([] { (void)ground_height_from("Mean"); },
              ThrowsSaying<std::invalid_argument>({"'Mean'", "local or mean"}));
}

}  // namespace projection_paper_test
}  // namespace stillmap::mapping
