#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/mapping/projection.hpp>

#include <cmath>
#include <limits>
#include <numbers>

#include "support/throws.hpp"

namespace stillmap::mapping {
namespace projection_test {

using test::ThrowsSaying;
using ::testing::ElementsAre;

/// z = -2 + 0.1 x, unknown beyond x = 50 m.
class Slope final : public GroundSurface {
 public:
  [[nodiscard]] std::optional<Sample> at(double x, double /*y*/) const override {
    if (!(x < 50.0)) return std::nullopt;
    return Sample{-2.0 + 0.1 * x, Eigen::Vector3d(-0.1, 0.0, 1.0).normalized(), 1.0};
  }
};

maps::PointCloud cloud_of(std::vector<Eigen::Vector3f> points) {
  maps::PointCloud cloud;
  cloud.positions = std::move(points);
  return cloud;
}

GroundResult ground_for(const maps::PointCloud& cloud) {
  return {std::vector<std::uint8_t>(cloud.size(), 0), std::make_shared<Slope>()};
}

maps::Box box_at(const Eigen::Vector3d& centre, const Eigen::Vector3d& size_m, double yaw_rad) {
  return {.centre = centre, .size_m = size_m, .yaw_rad = yaw_rad};
}

ProjectionResult project(const maps::PointCloud& cloud, const std::vector<maps::Box>& boxes,
                         const ProjectionOptions& options = {}) {
  return project_objects(cloud, ground_for(cloud), boxes, options);
}

TEST(Projection, LeavesTheNeighbourInsideTheBoundsOfATurnedBox) {
  // 4 x 2 m at 45 degrees: its axis-aligned bounds reach 2.12 m to every side.
  const maps::Box box = box_at({10.0, 0.0, 0.0}, {4.0, 2.0, 2.0}, 0.25 * std::numbers::pi);
  const maps::PointCloud cloud = cloud_of({{11.2F, 1.2F, 0.0F}, {11.2F, -1.2F, 0.0F}});
  const ProjectionResult result = project(cloud, {box});
  EXPECT_THAT(result.fates, ElementsAre(PointFate::kProjected, PointFate::kKept));
  EXPECT_THAT(result.object_of_point, ElementsAre(1U, 0U));
  EXPECT_EQ(result.positions[1], cloud.positions[1]);
}

TEST(Projection, TurnsABoxAboutItsOwnCentreWithItsLengthAlongTheHeading) {
  const maps::Box box = box_at({10.0, 5.0, 0.0}, {4.0, 2.0, 2.0}, 0.5 * std::numbers::pi);
  const ProjectionResult result =
      project(cloud_of({{10.0F, 6.9F, 0.0F}, {11.9F, 5.0F, 0.0F}}), {box});
  EXPECT_THAT(result.fates, ElementsAre(PointFate::kProjected, PointFate::kKept));
}

TEST(Projection, LandsStraightBelowOnTheLocalSurfaceOfASlope) {
  const maps::PointCloud cloud = cloud_of({{10.0F, 1.0F, 0.5F}, {12.0F, -1.0F, 0.0F}});
  const ProjectionResult result = project(cloud, {box_at({11.0, 0.0, 0.0}, {4.0, 4.0, 4.0}, 0.0)});
  EXPECT_FLOAT_EQ(result.positions[0].z(), -1.0F);
  EXPECT_FLOAT_EQ(result.positions[1].z(), -0.8F);
  EXPECT_EQ(result.positions[0].head<2>(), cloud.positions[0].head<2>());
  EXPECT_EQ(result.projected, 2U);
}

TEST(Projection, LeavesGroundInsideABoxWhereItIs) {
  const maps::PointCloud cloud = cloud_of({{10.0F, 0.0F, -0.95F}, {10.0F, 0.0F, 0.0F}});
  GroundResult ground = ground_for(cloud);
  ground.is_ground[0] = 1;
  const ProjectionResult result =
      project_objects(cloud, ground, {box_at({10.0, 0.0, 0.0}, {4.0, 4.0, 4.0}, 0.0)}, {});
  EXPECT_THAT(result.fates, ElementsAre(PointFate::kGround, PointFate::kProjected));
  EXPECT_THAT(result.object_of_point, ElementsAre(0U, 1U));
  EXPECT_EQ(result.positions[0], cloud.positions[0]);
  EXPECT_EQ(result.ground, 1U);
}

TEST(Projection, LeavesEveryPointOutsideOfAllBoxesWhereItIs) {
  const maps::PointCloud cloud = cloud_of({{1.0F, 2.0F, 3.0F}, {-7.0F, 0.0F, -1.0F}});
  const ProjectionResult result = project(cloud, {box_at({10.0, 0.0, 0.0}, {4.0, 2.0, 2.0}, 0.0)});
  EXPECT_EQ(result.positions, cloud.positions);
  EXPECT_EQ(result.kept, 2U);
}

TEST(Projection, DeletesUnderDeleteAndKeepsUnderKeep) {
  const maps::PointCloud cloud = cloud_of({{10.0F, 0.0F, 0.0F}});
  const std::vector<maps::Box> boxes = {box_at({10.0, 0.0, 0.0}, {4.0, 2.0, 2.0}, 0.0)};
  ProjectionOptions options;
  options.policy = MovablePolicy::kDelete;
  const ProjectionResult deleted = project(cloud, boxes, options);
  EXPECT_THAT(deleted.fates, ElementsAre(PointFate::kDeleted));
  EXPECT_EQ(deleted.deleted, 1U);
  EXPECT_EQ(deleted.without_ground, 0U);
  options.policy = MovablePolicy::kKeep;
  const ProjectionResult kept = project(cloud, boxes, options);
  EXPECT_THAT(kept.fates, ElementsAre(PointFate::kKept));
  EXPECT_THAT(kept.object_of_point, ElementsAre(1U));
  EXPECT_EQ(kept.positions, cloud.positions);
}

TEST(Projection, DeletesAndCountsWhatHasNoGroundBelow) {
  const ProjectionResult result =
      project(cloud_of({{60.0F, 0.0F, 0.0F}}), {box_at({60.0, 0.0, 0.0}, {4.0, 2.0, 2.0}, 0.0)});
  EXPECT_THAT(result.fates, ElementsAre(PointFate::kDeleted));
  EXPECT_EQ(result.deleted, 1U);
  EXPECT_EQ(result.without_ground, 1U);
  EXPECT_EQ(result.projected, 0U);
}

TEST(Projection, GivesAPointOfTwoBoxesToTheFirst) {
  const std::vector<maps::Box> boxes = {box_at({10.0, 0.0, 0.0}, {4.0, 2.0, 2.0}, 0.0),
                                        box_at({11.0, 0.0, 0.0}, {4.0, 2.0, 2.0}, 0.0)};
  const ProjectionResult result =
      project(cloud_of({{11.0F, 0.0F, 0.0F}, {12.9F, 0.0F, 0.0F}}), boxes);
  EXPECT_THAT(result.object_of_point, ElementsAre(1U, 2U));
}

TEST(Projection, GrowsBoxesByTheMarginOnEverySide) {
  const maps::PointCloud cloud = cloud_of(
      {{12.05F, 0.0F, 0.0F}, {10.0F, -1.05F, 0.0F}, {10.0F, 0.0F, 1.05F}, {12.15F, 0.0F, 0.0F}});
  const std::vector<maps::Box> boxes = {box_at({10.0, 0.0, 0.0}, {4.0, 2.0, 2.0}, 0.0)};
  EXPECT_EQ(project(cloud, boxes, {.margin_m = 0.1, .margin_up_m = 0.1}).projected, 3U);
  EXPECT_EQ(project(cloud, boxes, {.margin_m = 0.0, .margin_up_m = 0.0}).projected, 0U);
}

TEST(Projection, OfNothingIsEmpty) {
  const ProjectionResult result = project({}, {box_at({0, 0, 0}, {1, 1, 1}, 0.0)});
  EXPECT_TRUE(result.positions.empty());
  EXPECT_TRUE(result.fates.empty());
}

TEST(Projection, RefusesABoxThatIsNotFiniteOrHasNoSize) {
  const maps::PointCloud cloud = cloud_of({{10.0F, 0.0F, 0.0F}});
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const maps::Box good = box_at({10.0, 0.0, 0.0}, {4.0, 2.0, 2.0}, 0.0);
  for (const maps::Box& bad :
       {box_at({10.0, 0.0, 0.0}, {4.0, 2.0, 2.0}, nan), box_at({nan, 0.0, 0.0}, {4, 2, 2}, 0.0),
        box_at({10.0, 0.0, 0.0}, {4.0, 0.0, 2.0}, 0.0), box_at({10, 0, 0}, {4, nan, 2}, 0.0)}) {
    EXPECT_THAT(
        [&] {
          (void)project(cloud, {good, bad});
        },
        ThrowsSaying<std::invalid_argument>({"box 1"}));
  }
}

TEST(Projection, RefusesABoxThatIsInfiniteAsFloats) {
  const maps::PointCloud cloud = cloud_of({{10.0F, 0.0F, 0.0F}});
  const maps::Box good = box_at({10.0, 0.0, 0.0}, {4.0, 2.0, 2.0}, 0.0);
  for (const maps::Box& bad : {box_at({-1e300, 0.0, 0.0}, {4.0, 2.0, 2.0}, 0.0),
                               box_at({10.0, 0.0, 0.0}, {4.0, 1e300, 2.0}, 0.0)}) {
    EXPECT_THAT(
        [&] {
          (void)project(cloud, {good, bad});
        },
        ThrowsSaying<std::invalid_argument>({"box 1", "1e+300"}));
  }
}

TEST(Projection, RefusesFlagsOfAnotherCloudNoSurfaceAndABrokenMargin) {
  const maps::PointCloud cloud = cloud_of({{10.0F, 0.0F, 0.0F}});
  EXPECT_THAT([&] { (void)project_objects(cloud, ground_for({}), {}, {}); },
              ThrowsSaying<std::invalid_argument>({"ground flags: 0", "(1)"}));
  EXPECT_THAT(
      [&] {
        (void)project_objects(cloud, {{0}, nullptr}, {}, {});
      },
      ThrowsSaying<std::invalid_argument>({"ground surface"}));
  for (const double margin_m : {-0.1, 1.1, std::numeric_limits<double>::quiet_NaN()}) {
    EXPECT_THAT([&] { (void)project(cloud, {}, {.margin_m = margin_m}); },
                ThrowsSaying<std::invalid_argument>({"margin_m"}));
  }
}

TEST(MovablePolicy, HasANameThatReadsBack) {
  for (const MovablePolicy policy :
       {MovablePolicy::kProject, MovablePolicy::kDelete, MovablePolicy::kKeep})
    EXPECT_EQ(movable_policy_from(name_of(policy)), policy);
  EXPECT_EQ(name_of(MovablePolicy::kProject), "project");
  EXPECT_EQ(name_of(MovablePolicy::kDelete), "delete");
  EXPECT_EQ(name_of(MovablePolicy::kKeep), "keep");
  EXPECT_THAT([] { (void)movable_policy_from("Project"); },
              ThrowsSaying<std::invalid_argument>({"'Project'", "project, delete or keep"}));
}

}  // namespace projection_test
}  // namespace stillmap::mapping
