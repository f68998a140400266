#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/mapping/projection.hpp>

#include <cmath>
#include <limits>

#include "projection/box_columns.hpp"
#include "support/synthetic_world.hpp"
#include "support/throws.hpp"

namespace stillmap::mapping {
namespace projection_heights_test {

using test::ThrowsSaying;
using ::testing::Each;
using ::testing::ElementsAre;

/// A road at z = -2, right within 6 cm, known for x < 50 m.
class Road final : public GroundBelow {
 public:
  [[nodiscard]] std::optional<Foot> below(const Eigen::Vector3f& p) const override {
    if (!(p.x() < 50.0F)) return std::nullopt;
    return Foot{{p.x(), p.y(), -2.0F}, static_cast<double>(p.z()) + 2.0, 0.06, 1.0};
  }
};

MovableBox car_at(double x, double y, maps::ObjectClass object_class = maps::ObjectClass::kCar) {
  return {{.centre = {x, y, -1.25},
           .size_m = {4.0, 2.0, 1.5},
           .yaw_rad = 0.0,
           .object_class = object_class}};
}

struct Case {
  std::vector<Eigen::Vector3f> points;
  /// All 0 when left empty.
  std::vector<std::uint8_t> is_ground = {};
  std::vector<MovableBox> boxes = {car_at(10.0, 0.0)};
  ProjectionOptions options = {};

  [[nodiscard]] ProjectionResult run() const {
    maps::PointCloud cloud;
    cloud.positions = points;
    std::vector<std::uint8_t> flags = is_ground;
    flags.resize(points.size(), 0);
    return project_objects(cloud, flags, Road(), boxes, options);
  }
  [[nodiscard]] std::vector<PointFate> fates() const { return run().fates; }
};

/// Heights over the road, at the car's middle.
Case at_heights(const std::vector<float>& heights) {
  Case c;
  for (const float height : heights) c.points.emplace_back(10.0F, 0.0F, -2.0F + height);
  return c;
}

TEST(ProjectionHeights, TakeATyreThatWasLabelledGround) {
  Case c = at_heights({0.03F, 0.08F, 0.15F});
  c.is_ground = {1, 1, 1};
  const ProjectionResult result = c.run();
  EXPECT_THAT(result.fates,
              ElementsAre(PointFate::kGround, PointFate::kProjected, PointFate::kProjected));
  EXPECT_EQ(result.ground_taken_back, 2U);
  EXPECT_FLOAT_EQ(result.positions[2].z(), -2.0F);
  EXPECT_THAT(result.object_of_point, ElementsAre(0U, 1U, 1U));
}

TEST(ProjectionHeights, LeaveWhatLiesOnTheRoadThoughNotLabelled) {
  EXPECT_THAT(at_heights({-0.04F, 0.0F, 0.04F, 0.06F}).fates(),
              ElementsAre(PointFate::kGround, PointFate::kGround, PointFate::kGround,
                          PointFate::kProjected));
}

TEST(ProjectionHeights, LeaveWhatIsBelowTheRoad) {
  Case c = at_heights({-0.06F, -0.4F});
  EXPECT_THAT(c.fates(), Each(PointFate::kKept));
  EXPECT_EQ(c.run().positions, c.points);
}

TEST(ProjectionHeights, LeaveACrownAboveACarUnlessItReachesIntoTheBox) {
  // The box ends 1.5 m over the road, its upper margin at 1.75 m.
  EXPECT_THAT(at_heights({1.45F, 1.7F, 1.8F, 3.0F}).fates(),
              ElementsAre(PointFate::kProjected, PointFate::kProjected, PointFate::kKept,
                          PointFate::kKept));
}

TEST(ProjectionHeights, TakeNothingAboveThreeAndAHalfMetresButOfTallClasses) {
  for (const auto& [object_class, fate] :
       {std::pair(maps::ObjectClass::kCar, PointFate::kKept),
        std::pair(maps::ObjectClass::kVan, PointFate::kKept),
        std::pair(maps::ObjectClass::kUnknown, PointFate::kKept),
        std::pair(maps::ObjectClass::kTruck, PointFate::kProjected),
        std::pair(maps::ObjectClass::kBus, PointFate::kProjected),
        std::pair(maps::ObjectClass::kTrailer, PointFate::kProjected),
        std::pair(maps::ObjectClass::kTram, PointFate::kProjected)}) {
    Case c = at_heights({3.4F, 3.6F, 4.2F, 4.3F});
    c.boxes = {car_at(10.0, 0.0, object_class)};
    // From the road up to 4 m, 4.25 m with the margin.
    c.boxes[0].box.centre.z() = 0.0;
    c.boxes[0].box.size_m.z() = 4.0;
    EXPECT_THAT(c.fates(), ElementsAre(PointFate::kProjected, fate, fate, PointFate::kKept))
        << maps::name_of(object_class);
  }
}

TEST(ProjectionHeights, ReachTheRoadFromABoxThatEndsAboveIt) {
  Case c = at_heights({0.1F, 0.3F, 0.6F});
  c.boxes[0].box.centre.z() = -0.75;  // bottom at 0.5 m
  EXPECT_THAT(c.fates(), Each(PointFate::kProjected));
  c.boxes[0].box.centre.z() = 0.25;  // bottom at 1.5 m: no box of something that stands there
  EXPECT_THAT(c.fates(), Each(PointFate::kKept));
}

TEST(ProjectionHeights, TakeTheUpperHalfOfABoxHalfUnderTheRoad) {
  Case c = at_heights({-0.5F, 0.0F, 0.5F, 0.7F});
  c.boxes[0].box.centre.z() = -2.0;
  EXPECT_THAT(c.fates(), ElementsAre(PointFate::kKept, PointFate::kGround, PointFate::kProjected,
                                     PointFate::kProjected));
}

TEST(ProjectionHeights, LeaveATunnelsCeilingAndWallsWhereTheyAre) {
  Case c;
  c.points = {{10.0F, 0.0F, 2.0F}, {10.0F, 3.0F, -1.0F}, {10.0F, 1.5F, -1.0F}};
  EXPECT_THAT(c.fates(), Each(PointFate::kKept));
}

TEST(ProjectionHeights, KeepGroundWhereNoSurfaceIsKnownAndDropTheRest) {
  Case c;
  c.points = {{60.0F, 0.0F, -2.0F}, {60.0F, 0.0F, -1.0F}};
  c.is_ground = {1, 0};
  c.boxes = {car_at(60.0, 0.0)};
  const ProjectionResult result = c.run();
  EXPECT_THAT(result.fates, ElementsAre(PointFate::kGround, PointFate::kDeleted));
  EXPECT_EQ(result.without_ground, 1U);
}

TEST(ProjectionHeights, OfAnAllGroundScanWithoutBoxesChangeNothing) {
  Case c;
  c.points = {{1.0F, 0.0F, -2.0F}, {2.0F, 0.0F, -2.0F}};
  c.is_ground = {1, 1};
  c.boxes.clear();
  EXPECT_THAT(c.fates(), Each(PointFate::kGround));
  EXPECT_EQ(c.run().positions, c.points);
}

TEST(ProjectionClasses, PassOverWhatIsNotMovable) {
  Case c;
  c.points = {{10.0F, 0.0F, -1.0F}, {20.0F, 0.0F, -1.0F}};
  c.boxes = {car_at(10.0, 0.0, maps::ObjectClass::kCar),
             car_at(20.0, 0.0, maps::ObjectClass::kTram)};
  c.options.classes = {maps::ObjectClass::kTram};
  const ProjectionResult result = c.run();
  EXPECT_THAT(result.fates, ElementsAre(PointFate::kKept, PointFate::kProjected));
  EXPECT_THAT(result.object_of_point, ElementsAre(0U, 2U));
}

TEST(ProjectionOfMovers, DrawsTheBoxOutAlongItsHeadingByHalfASweep) {
  Case c;
  // 2 m and the margin of 0.1 m ahead; 10 m/s add half a metre.
  c.points = {
      {12.5F, 0.0F, -1.0F}, {7.5F, 0.0F, -1.0F}, {12.7F, 0.0F, -1.0F}, {10.0F, 1.4F, -1.0F}};
  EXPECT_THAT(c.fates(), Each(PointFate::kKept));
  c.boxes[0].speed_mps = 10.0;
  EXPECT_THAT(c.fates(), ElementsAre(PointFate::kProjected, PointFate::kProjected, PointFate::kKept,
                                     PointFate::kKept));
  c.options.half_sweep_s = 0.0;
  EXPECT_THAT(c.fates(), Each(PointFate::kKept));
}

TEST(ProjectionOfMovers, RefusesASpeedThatIsNotFiniteOrBeyondAll) {
  Case c = at_heights({1.0F});
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), -1e300}) {
    c.boxes[0].speed_mps = bad;
    EXPECT_THAT([&] { (void)c.run(); }, ThrowsSaying<std::invalid_argument>({"box 0", "speed"}));
  }
}

TEST(ProjectionOptions, RefusesWhatIsOutOfBoundsByName) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const double bad : {-0.1, 2.1, nan}) {
    Case c = at_heights({1.0F});
    c.options.margin_up_m = bad;
    EXPECT_THAT([&] { (void)c.run(); }, ThrowsSaying<std::invalid_argument>({"margin_up_m"}));
    c.options = {};
    c.options.half_sweep_s = bad;
    EXPECT_THAT([&] { (void)c.run(); }, ThrowsSaying<std::invalid_argument>({"half_sweep_s"}));
  }
}

TEST(BoxColumns, FindTheFirstBoxThatHoldsAPoint) {
  test::Random random(3);
  std::vector<MovableBox> boxes;
  for (int k = 0; k < 40; ++k) {
    boxes.push_back({{.centre = {random.uniform(-60, 60), random.uniform(-60, 60), 0.0},
                      .size_m = {random.uniform(1, 12), random.uniform(1, 3), 3.0},
                      .yaw_rad = random.uniform(-4, 4)}});
  }
  // Far away: costs no memory, and is found.
  boxes.push_back({{.centre = {3e5, -2e5, 0.0}, .size_m = {4.0, 2.0, 3.0}}});
  ProjectionOptions options;
  options.ground_height = GroundHeight::kMean;  // without margins
  const BoxColumns columns(boxes, options);
  int found = 0;
  for (int k = 0; k < 20000; ++k) {
    const Eigen::Vector3d p(random.uniform(-70, 70), random.uniform(-70, 70),
                            random.uniform(-2, 2));
    int expected = -1;
    bool at_a_side = false;
    for (int b = 40; b >= 0; --b) {
      const maps::Box& box = boxes[static_cast<std::size_t>(b)].box;
      if (box.contains(p)) expected = b;
      at_a_side |= box.contains(p, 1e-4) != box.contains(p, -1e-4);
    }
    if (at_a_side) continue;
    EXPECT_EQ(columns.first_with(p.cast<float>()), expected);
    if (expected >= 0) ++found;
  }
  EXPECT_GT(found, 300);
  EXPECT_EQ(columns.first_with({3e5F + 1.5F, -2e5F, 0.0F}), 40);
  EXPECT_EQ(columns.first_with({2e5F, -2e5F, 0.0F}), -1);
}

TEST(BoxColumns, OfNoBoxFindNothing) {
  const BoxColumns columns({}, {});
  EXPECT_EQ(columns.first_with({0.0F, 0.0F, 0.0F}), -1);
}

}  // namespace projection_heights_test
}  // namespace stillmap::mapping
