#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/mapping/label_evaluation.hpp>
#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>

#include "labelled_world.hpp"
#include "support/package_steps.hpp"
#include "support/throws.hpp"

namespace stillmap::mapping {
namespace label_evaluation_test {

using maps::PointFate;
using test::Handled;
using test::HandMadeMap;
using test::LabelledWorld;
using test::WorldPoint;

constexpr std::uint32_t kRoad = 40, kCar = 10, kMovingCar = 252, kBuilding = 50;

LabelEvaluation judge(const HandMadeMap& hand, const maps::MapPackage& map,
                      const std::string& drive = "drive") {
  CancelFlag cancel{false};
  return evaluate_with_labels(map, maps::Drive::open(hand.write_drive(drive)), false, {}, cancel);
}

bool is_movable(std::uint32_t label) { return label == kCar || label == kMovingCar; }

/// Everything stays where it was.
Handled keep(const WorldPoint& point) {
  return {point.label == kRoad ? PointFate::kGround : PointFate::kKept, point.p};
}

/// Cars go, and nothing is put in their place.
Handled delete_movable(const WorldPoint& point) {
  if (is_movable(point.label)) return {PointFate::kDeleted, std::nullopt};
  return keep(point);
}

/// A street with a parked car, a moving one and a wall. No ground is seen below the cars; the wall
/// stands off the ground, out of reach of everything else.
LabelledWorld street() {
  LabelledWorld world;
  world.add_ground(-3.0, 8.0, -3.0, 3.0, [](double x, double y) {
    const bool parked = x > 4.0 && x < 6.0 && y > 0.0 && y < 1.0;
    const bool moving = x > 4.0 && x < 6.0 && y > -2.0 && y < -1.0;
    return !parked && !moving;
  });
  world.add_box({4.0, 0.0, 0.3}, {6.0, 1.0, 1.3}, kCar);
  world.add_box({4.0, -2.0, 0.3}, {6.0, -1.0, 1.3}, kMovingCar);
  world.add_box({-3.0, 4.0, 0.5}, {8.0, 4.1, 2.5}, kBuilding);
  return world;
}
constexpr std::size_t kCarPoints = 20 * 10 * 10;
constexpr std::size_t kRoadPoints = 110 * 60 - 2 * 200;
constexpr std::size_t kWallPoints = 110 * 20;

maps::MapObject parked_car() {
  maps::MapObject car;
  car.size_m = {2.0, 1.0, 1.3};
  car.motion = maps::ObjectMotion::kParked;
  car.placements = {{0, {5.0, 0.5, 0.65}, 0.0}};
  car.points_removed = kCarPoints;
  return car;
}

TEST(LabelEvaluation, AMapThatKeepsAllHasSaOneAndDaZeroAndLosesNothing) {
  const HandMadeMap hand(street());
  const LabelEvaluation result = judge(hand, *hand.build(keep));
  EXPECT_TRUE(result.drive_in_map);
  EXPECT_EQ(result.points, kRoadPoints + kWallPoints + 2 * kCarPoints);
  ASSERT_TRUE(result.unthinned);
  for (const MapFigures* figures : {&*result.unthinned, &result.thinned}) {
    const MapScores& movable = figures->of(TruthClasses::kMovable);
    EXPECT_EQ(movable.SA, 1.0);
    EXPECT_EQ(movable.DA, 0.0);
    EXPECT_EQ(movable.AA, 0.0);
    EXPECT_EQ(movable.PR, 1.0);
    EXPECT_EQ(movable.RR, 0.0);
    EXPECT_EQ(movable.static_loss, 0.0);
    EXPECT_EQ(movable.static_kept.of, kRoadPoints + kWallPoints);
    EXPECT_EQ(movable.dynamic_removed.of, 2 * kCarPoints);
    // Parked cars are static among moving ones.
    EXPECT_EQ(figures->of(TruthClasses::kMoving).static_kept.of,
              kRoadPoints + kWallPoints + kCarPoints);
    EXPECT_EQ(figures->of(TruthClasses::kMoving).dynamic_removed.of, kCarPoints);
    EXPECT_EQ(figures->parked_removed.rate(), 0.0);
    EXPECT_TRUE(std::isnan(figures->ground_under.filled.rate()));
  }
  EXPECT_EQ(result.ground->precision(), 1.0);
  EXPECT_EQ(result.ground->recall(), 1.0);
  EXPECT_EQ(result.heights->all.points, 0U);
}

TEST(LabelEvaluation, AMapWithoutTheMovableHasAllOnes) {
  const HandMadeMap hand(street());
  const LabelEvaluation result = judge(hand, *hand.build(delete_movable, {}, {parked_car()}));
  for (const MapFigures* figures : {&*result.unthinned, &result.thinned}) {
    const MapScores& movable = figures->of(TruthClasses::kMovable);
    EXPECT_EQ(movable.SA, 1.0);
    EXPECT_EQ(movable.DA, 1.0);
    EXPECT_EQ(movable.AA, 1.0);
    EXPECT_EQ(movable.HA, 1.0);
    EXPECT_EQ(movable.PR, 1.0);
    EXPECT_EQ(movable.RR, 1.0);
    EXPECT_EQ(movable.F1, 1.0);
    EXPECT_EQ(movable.static_loss, 0.0);
    EXPECT_EQ(figures->parked_removed.rate(), 1.0);
    // What moves is gone, and the parked car with it, which counts as lost here.
    const MapScores& moving = figures->of(TruthClasses::kMoving);
    EXPECT_EQ(moving.DA, 1.0);
    EXPECT_EQ(moving.static_kept.of - moving.static_kept.count, kCarPoints);
    EXPECT_EQ(moving.static_lost.count, kCarPoints);
    EXPECT_EQ(figures->ground_under.filled.of, 8U * 4U);
    EXPECT_EQ(figures->ground_under.filled.count, 0U);
  }
  EXPECT_EQ(result.parked_objects, 1U);
}

TEST(LabelEvaluation, CountsParkedPointsFromThirtyCentimetresOverTheGround) {
  LabelledWorld world = street();
  world.add_box({4.0, 0.0, 0.1}, {6.0, 1.0, 0.3}, kCar);
  const HandMadeMap hand(world);
  const LabelEvaluation result = judge(hand, *hand.build(delete_movable));
  EXPECT_EQ(result.unthinned->parked_removed.of, kCarPoints);
}

TEST(LabelEvaluation, ProjectedPointsAreNotMatchedButInThePlainFigure) {
  // A car that touches the road: its lowest points have projected ones 2 cm below them.
  LabelledWorld world;
  world.add_ground(-3.0, 3.0, -3.0, 3.0);
  for (double x = 10.05; x < 12.0; x += 0.1) {
    world.points.push_back({{x, 0.05, 0.02}, kCar});
    world.points.push_back({{x, 0.05, 1.02}, kCar});
  }
  const HandMadeMap hand(world);
  const auto map = hand.build([](const WorldPoint& point) {
    if (point.label != kCar) return keep(point);
    return Handled{PointFate::kProjected, Eigen::Vector3d(point.p.x(), point.p.y(), 0.0)};
  });
  const LabelEvaluation result = judge(hand, *map);
  for (const MapFigures* figures : {&*result.unthinned, &result.thinned}) {
    const MapScores& movable = figures->of(TruthClasses::kMovable);
    EXPECT_EQ(movable.DA, 1.0);
    EXPECT_EQ(movable.plain_removed.rate(), 0.5);
  }
}

TEST(LabelEvaluation, AnEmptyRegionIsLostBelowTheWallThatIsGone) {
  // The build ate the left half of the wall, and half of its lower half with it.
  const HandMadeMap hand(street());
  const LabelEvaluation result = judge(hand, *hand.build([](const WorldPoint& point) {
    const bool eaten = point.label == kBuilding && point.p.x() < 2.5;
    // Kept by the first pass, then cleaned: its fate says kept, and its voxel is empty.
    return eaten ? Handled{PointFate::kKept, std::nullopt} : keep(point);
  }));
  const std::size_t eaten = kWallPoints / 2;
  for (const MapFigures* figures : {&*result.unthinned, &result.thinned}) {
    const MapScores& movable = figures->of(TruthClasses::kMovable);
    // The column next to the half that stays has a point 0.1 m away.
    EXPECT_EQ(movable.static_lost.count, eaten - 20);
    EXPECT_EQ(movable.static_kept.of - movable.static_kept.count, eaten);
    const auto wall = std::find_if(figures->losses.begin(), figures->losses.end(),
                                   [](const ClassLoss& loss) { return loss.label == kBuilding; });
    ASSERT_NE(wall, figures->losses.end());
    EXPECT_EQ(wall->lost.count, eaten - 20);
    EXPECT_EQ(wall->lost.of, kWallPoints);
  }
}

TEST(LabelEvaluation, TakesOffWhatThinningAloneLoses) {
  // Two voxels. In the first the map holds one of two points instead of their mean, which is 0.083
  // m from both. In the second it holds the mean of all four, which is 0.12 m from one of them.
  LabelledWorld world;
  world.points = {{{0.002, 0.002, 0.002}, kBuilding}, {{0.098, 0.098, 0.098}, kBuilding},
                  {{5.002, 5.002, 5.002}, kBuilding}, {{5.002, 5.002, 5.002}, kBuilding},
                  {{5.002, 5.002, 5.002}, kBuilding}, {{5.098, 5.098, 5.098}, kBuilding}};
  HandMadeMap hand(world);
  hand.with_surface = false;
  int number = 0;
  const auto map = hand.build([&](const WorldPoint& point) {
    ++number;
    if (number == 1) return Handled{PointFate::kKept, point.p};
    if (number == 3) return Handled{PointFate::kKept, Eigen::Vector3d(5.026, 5.026, 5.026)};
    return Handled{PointFate::kKept, std::nullopt};
  });
  const LabelEvaluation result = judge(hand, *map);
  const MapScores& thinned = result.thinned.of(TruthClasses::kMovable);
  EXPECT_EQ(thinned.static_lost.count, 2U);
  EXPECT_EQ(thinned.static_lost_uncleaned.count, 1U);
  EXPECT_DOUBLE_EQ(thinned.static_loss, 1.0 / 6.0);
  // Nothing is gone from the unthinned map.
  EXPECT_EQ(result.unthinned->of(TruthClasses::kMovable).static_lost.count, 0U);
}

TEST(LabelEvaluation, AProjectedPointThatWasStaticIsLost) {
  const HandMadeMap hand(street());
  const LabelEvaluation result = judge(hand, *hand.build([](const WorldPoint& point) {
    if (point.label != kBuilding) return keep(point);
    return Handled{PointFate::kProjected, Eigen::Vector3d(point.p.x(), point.p.y(), 0.0)};
  }));
  EXPECT_EQ(result.unthinned->of(TruthClasses::kMovable).static_lost.count, kWallPoints);
}

std::vector<Eigen::Vector3d> fill(double over_m, const LabelledWorld& world) {
  std::vector<Eigen::Vector3d> filled;
  for (double x = 4.05; x < 6.0; x += 0.1) {
    for (double y = 0.05; y < 1.0; y += 0.1) filled.emplace_back(x, y, world.ground(x, y) + over_m);
  }
  return filled;
}

TEST(LabelEvaluation, GroundFilledAtItsHeightIsCompleteAndExact) {
  LabelledWorld world = street();
  world.slope = 0.08;
  const HandMadeMap hand(world);
  const LabelEvaluation result =
      judge(hand, *hand.build(delete_movable, fill(0.0, world), {parked_car()}));
  for (const MapFigures* figures : {&*result.unthinned, &result.thinned}) {
    EXPECT_EQ(figures->ground_under.filled.rate(), 1.0);
    EXPECT_EQ(figures->ground_under.projected.rate(), 0.0);
  }
  EXPECT_EQ(result.heights->filled.points, 200U);
  EXPECT_LT(result.heights->filled.p95_m, test::kOffByStepsM);
  EXPECT_EQ(result.heights->projected.points, 0U);
}

TEST(LabelEvaluation, GroundFilledSevenCentimetresTooHighIsNoGroundAndSaysSo) {
  const LabelledWorld world = street();
  const HandMadeMap hand(world);
  const LabelEvaluation result =
      judge(hand, *hand.build(delete_movable, fill(0.07, world), {parked_car()}));
  EXPECT_EQ(result.unthinned->ground_under.filled.rate(), 0.0);
  EXPECT_NEAR(result.heights->all.median_m, 0.07, test::kOffByStepsM);
  EXPECT_NEAR(result.heights->filled.p95_m, 0.07, test::kOffByStepsM);
}

TEST(LabelEvaluation, ProjectedGroundCountsWithAndWithoutTheFilledOne) {
  // The left half of the car is projected, the other half is filled 4 cm too low.
  LabelledWorld world = street();
  std::vector<Eigen::Vector3d> filled = fill(-0.04, world);
  std::erase_if(filled, [](const Eigen::Vector3d& p) { return p.x() < 5.0; });
  const HandMadeMap hand(world);
  const auto map = hand.build(
      [](const WorldPoint& point) {
        if (point.label != kCar) return delete_movable(point);
        if (point.p.x() > 5.0) return Handled{PointFate::kDeleted, std::nullopt};
        return Handled{PointFate::kProjected, Eigen::Vector3d(point.p.x(), point.p.y(), 0.0)};
      },
      filled, {parked_car()});
  const LabelEvaluation result = judge(hand, *map);
  for (const MapFigures* figures : {&*result.unthinned, &result.thinned}) {
    EXPECT_EQ(figures->ground_under.projected.rate(), 0.5);
    EXPECT_EQ(figures->ground_under.filled.rate(), 1.0);
  }
  EXPECT_NEAR(result.heights->filled.median_m, 0.04, test::kOffByStepsM);
  EXPECT_NEAR(result.heights->projected.p95_m, 0.0, test::kOffByStepsM);
}

TEST(LabelEvaluation, FootprintsAcrossAKerbAreToldFromThoseOnOneSurface) {
  // The map's ground ignores the kerb: 12 cm too low beyond it. Two cars, one of them across it.
  LabelledWorld world = street();
  world.kerb = true;
  maps::MapObject across = parked_car();
  across.placements = {{0, {-1.0, 1.0, 0.65}, 0.0}};
  std::vector<Eigen::Vector3d> filled = fill(0.01, LabelledWorld{});
  for (double y = 0.55; y < 1.5; y += 0.1) filled.emplace_back(-1.05, y, 0.0);
  const HandMadeMap hand(world);
  const LabelEvaluation result =
      judge(hand, *hand.build(delete_movable, filled, {parked_car(), across}));
  EXPECT_EQ(result.heights->one_surface.points, 200U);
  EXPECT_NEAR(result.heights->one_surface.p95_m, 0.01, test::kOffByStepsM);
  EXPECT_EQ(result.heights->across_kerb.points, 10U);
  EXPECT_NEAR(result.heights->across_kerb.p95_m, 0.12, test::kOffByStepsM);
}

TEST(LabelEvaluation, FootprintsOfMovingObjectsDoNotCount) {
  const HandMadeMap hand(street());
  maps::MapObject moving = parked_car();
  moving.motion = maps::ObjectMotion::kMoving;
  const LabelEvaluation result = judge(hand, *hand.build(delete_movable, {}, {moving}));
  EXPECT_EQ(result.moving_objects, 1U);
  EXPECT_EQ(result.unthinned->ground_under.filled.of, 0U);
}

TEST(LabelEvaluation, GroundCountsByThePatchworkProtocol) {
  // Of 4 road points one is missed; of 2 wall points one is called ground; vegetation is left out.
  LabelledWorld world;
  for (int i = 0; i < 4; ++i) world.points.push_back({{5.0 + i, 0.05, 0.0}, kRoad});
  for (int i = 0; i < 2; ++i) world.points.push_back({{5.0 + i, 3.05, 1.0}, kBuilding});
  for (int i = 0; i < 3; ++i) world.points.push_back({{5.0 + i, 6.05, 1.0}, 70});
  const HandMadeMap hand(world);
  int number = 0;
  const auto map = hand.build([&](const WorldPoint& point) {
    const bool ground = number != 0 && number != 4;
    ++number;
    return Handled{ground ? PointFate::kGround : PointFate::kKept, point.p};
  });
  const LabelEvaluation result = judge(hand, *map);
  EXPECT_EQ(result.ground->true_positives, 3U);
  EXPECT_EQ(result.ground->false_negatives, 1U);
  EXPECT_EQ(result.ground->false_positives, 1U);
  EXPECT_EQ(result.ground->f1(), 0.75);
}

TEST(LabelEvaluation, DroppedAndUnlabelledPointsAreLeftOut) {
  LabelledWorld world = street();
  world.add_box({20.0, 20.0, 0.0}, {20.5, 20.1, 0.1}, 1);
  const HandMadeMap hand(world);
  const LabelEvaluation result = judge(hand, *hand.build([](const WorldPoint& point) {
    return point.label == kMovingCar ? Handled{PointFate::kDropped, std::nullopt} : keep(point);
  }));
  EXPECT_EQ(result.dropped, kCarPoints);
  EXPECT_EQ(result.ignored, 5U);
  EXPECT_TRUE(std::isnan(result.unthinned->of(TruthClasses::kMoving).DA));
  EXPECT_EQ(result.unthinned->of(TruthClasses::kMovable).static_kept.of, kRoadPoints + kWallPoints);
}

TEST(LabelEvaluation, TruthBeyondFiftyMetresCountsForLossOnly) {
  LabelledWorld world = street();
  world.add_box({60.0, 0.0, 0.0}, {61.0, 0.1, 1.0}, kBuilding);
  const HandMadeMap hand(world);
  const LabelEvaluation result = judge(hand, *hand.build(keep));
  const MapScores& movable = result.unthinned->of(TruthClasses::kMovable);
  EXPECT_EQ(movable.static_kept.of, kRoadPoints + kWallPoints);
  EXPECT_EQ(movable.static_lost.of, kRoadPoints + kWallPoints + 100);
}

TEST(LabelEvaluation, FollowsAMapThatIsTurnedAndShifted) {
  // A map by odometry has a frame of its own; true ground is in the drive's.
  LabelledWorld world = street();
  world.slope = 0.05;
  HandMadeMap hand(world);
  hand.T_map_truth.translate(Eigen::Vector3d(3.0, -2.0, 1.0));
  hand.T_map_truth.rotate(Eigen::AngleAxisd(0.5 * std::numbers::pi, Eigen::Vector3d::UnitZ()));
  maps::MapObject car = parked_car();
  car.placements[0].centre_map = hand.T_map_truth * car.placements[0].centre_map;
  car.placements[0].yaw_rad = 0.5 * std::numbers::pi;
  const LabelEvaluation result = judge(hand, *hand.build(delete_movable, fill(0.02, world), {car}));
  std::size_t high = 0;
  for (const WorldPoint& point : world.points)
    high += point.label == kCar && point.p.z() - 0.05 * point.p.x() > 0.3 ? 1 : 0;
  EXPECT_EQ(result.unthinned->parked_removed.of, high);
  EXPECT_EQ(result.unthinned->parked_removed.rate(), 1.0);
  EXPECT_EQ(result.unthinned->of(TruthClasses::kMovable).static_loss, 0.0);
  EXPECT_EQ(result.unthinned->ground_under.filled.rate(), 1.0);
  EXPECT_NEAR(result.heights->filled.median_m, 0.02, 1e-4);
}

TEST(LabelEvaluation, WithoutATrueSurfaceNothingIsSaidOfGroundUnderObjects) {
  HandMadeMap hand(street());
  hand.with_surface = false;
  const LabelEvaluation result = judge(hand, *hand.build(delete_movable, {}, {parked_car()}));
  EXPECT_EQ(result.true_ground, TrueGround::kLabels);
  EXPECT_FALSE(result.heights);
  // Labelled ground beside the car is enough to tell its body from the road.
  EXPECT_EQ(result.unthinned->parked_removed.of, kCarPoints);
  const auto json = nlohmann::json::parse(to_json(result, TruthClasses::kMovable));
  EXPECT_TRUE(json["ground_completeness"].is_null());
  EXPECT_TRUE(json["filled_height_error_m"]["median"].is_null());
  EXPECT_EQ(json["parked_removal"], 1.0);
}

TEST(LabelEvaluation, ADriveThatIsNotInTheMapJudgesThePackageAlone) {
  HandMadeMap hand(street());
  const auto map = hand.build(delete_movable, {}, {parked_car()});
  hand.scans = 2;
  const std::filesystem::path other = hand.write_drive("other");
  // Another clock: no scan of the map is in it.
  std::ofstream(other / "times.txt") << "7.0\n7.1\n";
  CancelFlag cancel{false};
  const LabelEvaluation result =
      evaluate_with_labels(*map, maps::Drive::open(other), false, {}, cancel);
  EXPECT_FALSE(result.drive_in_map);
  EXPECT_FALSE(result.unthinned);
  EXPECT_FALSE(result.ground);
  EXPECT_EQ(result.scans, 2U);
  EXPECT_EQ(result.thinned.of(TruthClasses::kMovable).SA, 1.0);
  EXPECT_EQ(result.thinned.of(TruthClasses::kMovable).DA, 1.0);
  const auto json = nlohmann::json::parse(to_json(result, TruthClasses::kMovable));
  EXPECT_EQ(json["map_points"], "thinned");
  EXPECT_EQ(json["SA"], 1.0);
  EXPECT_TRUE(json["ground"]["f1"].is_null());
}

TEST(LabelEvaluation, FindsTheDriveAmongSeveralAndCountsWhatTheOthersGave) {
  // Another day, with the same stamps, has a point 1 cm beside one of the moving car's.
  HandMadeMap hand(street());
  hand.scans = 3;
  hand.other_drive = {{4.06, -1.95, 0.35}};
  const LabelEvaluation result = judge(hand, *hand.build(delete_movable));
  EXPECT_TRUE(result.drive_in_map);
  EXPECT_EQ(result.drives, 2U);
  for (const MapFigures* figures : {&*result.unthinned, &result.thinned}) {
    const MapScores& movable = figures->of(TruthClasses::kMovable);
    EXPECT_EQ(movable.SA, 1.0);
    EXPECT_EQ(movable.dynamic_removed.of - movable.dynamic_removed.count, 3U);
  }
}

TEST(LabelEvaluation, WritesTheChosenClassesAtTheTop) {
  const HandMadeMap hand(street());
  const LabelEvaluation result = judge(hand, *hand.build(delete_movable, {}, {parked_car()}));
  const auto moving = nlohmann::json::parse(to_json(result, TruthClasses::kMoving));
  const auto movable = nlohmann::json::parse(to_json(result, TruthClasses::kMovable));
  for (const char* key : {"SA", "DA", "AA", "HA", "PR", "RR", "F1", "static_loss"}) {
    EXPECT_EQ(moving[key], moving["moving"][key]) << key;
    EXPECT_EQ(movable[key], movable["movable"][key]) << key;
    EXPECT_TRUE(movable["thinned"]["movable"].contains(key)) << key;
  }
  EXPECT_LT(moving["SA"], movable["SA"]);
  for (const char* key : {"parked_removal", "ground_completeness", "scans", "seconds"})
    EXPECT_TRUE(movable[key].is_number()) << key;
  EXPECT_EQ(movable["ground"]["f1"], 1.0);
}

TEST(LabelEvaluation, RefusesWhatCannotBeJudged) {
  LabelledWorld world = street();
  world.points[7].label = 3;
  const HandMadeMap hand(world);
  const auto map = hand.build(keep);
  EXPECT_THAT([&] { (void)judge(hand, *map); },
              test::ThrowsSaying<maps::InputError>({"000000.label", "class 3"}));
  const std::filesystem::path drive = hand.write_drive();
  CancelFlag never{false};
  std::ofstream(drive / "labels" / "000000.label") << "1234";
  EXPECT_THAT([&] { (void)evaluate_with_labels(*map, maps::Drive::open(drive), false, {}, never); },
              test::ThrowsSaying<maps::InputError>({"000000.label", "4 bytes"}));
  std::filesystem::remove_all(drive / "labels");
  EXPECT_THAT([&] { (void)evaluate_with_labels(*map, maps::Drive::open(drive), false, {}, never); },
              test::ThrowsSaying<maps::InputError>({"drive", "without labels"}));
}

TEST(LabelEvaluation, EndsWhenCancelled) {
  const HandMadeMap hand(street());
  const auto map = hand.build(keep);
  CancelFlag cancel{true};
  EXPECT_THROW(
      (void)evaluate_with_labels(*map, maps::Drive::open(hand.write_drive()), false, {}, cancel),
      Cancelled);
}

}  // namespace label_evaluation_test
}  // namespace stillmap::mapping
