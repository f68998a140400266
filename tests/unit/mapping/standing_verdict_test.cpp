#include "fusion/standing_verdict.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "fusion/standing_shape.hpp"
#include "support/synthetic_world.hpp"
#include "support/temporary_folder.hpp"

namespace stillmap::mapping {
namespace standing_verdict_test {

/// Flat ground 1.8 m below the sensor.
class Floor final : public GroundSurface {
 public:
  [[nodiscard]] std::optional<Sample> at(double, double) const override {
    return Sample{.z = -1.8};
  }
};

Eigen::Isometry3d sensor_at(double x, double y) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = Eigen::Vector3d(x, y, 1.8);
  return T;
}

/// Obstacles of a world, seen from a street that passes it at y = 0.
std::vector<ScanObstacles> scans_of(const test::SyntheticWorld& world, double highest_rad = 0.1) {
  std::vector<ScanObstacles> scans;
  test::ScanPattern pattern{
      .rings = 48, .columns = 900, .highest_rad = highest_rad, .noise_m = 0.01};
  for (int i = 0; i < 7; ++i) {
    const Eigen::Isometry3d T = sensor_at(3.0 * i, 0.0);
    pattern.seed = static_cast<std::uint64_t>(i + 1);
    const maps::PointCloud cloud = world.scan(T, pattern);
    std::vector<std::uint8_t> is_ground(cloud.size());
    for (std::size_t k = 0; k < cloud.size(); ++k)
      is_ground[k] = cloud.positions[k].z() < -1.7F ? 1 : 0;
    scans.push_back(reduce_obstacles(cloud.positions, is_ground, Floor(), T));
  }
  return scans;
}

ObstacleMap all_of(const std::vector<ScanObstacles>& scans) {
  const test::TemporaryFolder folder;
  ObstacleStore store(folder.path());
  for (const ScanObstacles& scan : scans) store.add(0, scan);
  store.finish();
  return store.around(0, {0.0, 0.0}, 500.0);
}

ObstacleMap seen(const test::SyntheticWorld& world) { return all_of(scans_of(world)); }

maps::Box box_at(double x, double y, const Eigen::Vector3d& size) {
  maps::Box box;
  box.centre = {x, y, 0.5 * size.z()};
  box.size_m = size;
  return box;
}

/// An object that was detected ten times at a place.
FusedObject object_of(const maps::Box& box, maps::ObjectClass object_class,
                      double existence = 0.9) {
  FusedObject object;
  object.object_class = object_class;
  object.size_m = box.size_m;
  object.existence = existence;
  for (std::size_t scan = 0; scan < 10; ++scan) object.placements.push_back({scan, box, true});
  return object;
}

const Eigen::Vector3d kCarSize(4.4, 1.8, 1.5);

/// A body over four wheels.
void add_car(test::SyntheticWorld& world, double x, double y) {
  world.boxes.push_back({{x - 2.2, y - 0.9, 0.35}, {x + 2.2, y + 0.9, 0.9}});
  world.boxes.push_back({{x - 1.0, y - 0.8, 0.9}, {x + 1.4, y + 0.8, 1.5}});
  for (const double dx : {-1.4, 1.4}) {
    for (const double dy : {-0.8, 0.65})
      world.boxes.push_back({{x + dx - 0.3, y + dy, 0.0}, {x + dx + 0.3, y + dy + 0.15, 0.6}});
  }
}

/// Leaves: small cubes here and there within a box.
void add_hedge(test::SyntheticWorld& world, const maps::Box& box) {
  test::Random random(5);
  for (int i = 0; i < 350; ++i) {
    Eigen::Vector3d p = box.centre;
    for (Eigen::Index axis = 0; axis < 3; ++axis)
      p[axis] += random.uniform(-0.5, 0.5) * box.size_m[axis];
    world.boxes.push_back(
        {p - Eigen::Vector3d::Constant(0.04), p + Eigen::Vector3d::Constant(0.04)});
  }
}

double log_odds_in(const test::SyntheticWorld& world, const maps::Box& box,
                   maps::ObjectClass object_class = maps::ObjectClass::kCar) {
  return vehicle_log_odds(object_of(box, object_class), shape_of(seen(world), box), 100);
}

TEST(StandingVerdict, BelievesInACar) {
  test::SyntheticWorld world;
  add_car(world, 10.0, 6.0);
  EXPECT_GT(log_odds_in(world, box_at(10.0, 6.0, kCarSize)), 0.0);
}

TEST(StandingVerdict, DoubtsAHedgeOfTheSizeOfACar) {
  test::SyntheticWorld world;
  const maps::Box box = box_at(10.0, 6.0, kCarSize);
  add_hedge(world, box);
  EXPECT_LT(log_odds_in(world, box), 0.0);
}

TEST(StandingVerdict, DoubtsAPieceOfAHouse) {
  test::SyntheticWorld world;
  world.boxes.push_back({{-20.0, 5.2, 0.0}, {40.0, 6.0, 6.0}});
  EXPECT_LT(log_odds_in(world, box_at(10.0, 6.0, kCarSize)), 0.0);
  EXPECT_LT(log_odds_in(world, box_at(10.0, 6.0, {6.0, 2.2, 3.0}), maps::ObjectClass::kVan), 0.0);
}

TEST(StandingShape, IsThatOfTheBoxWhereverItLies) {
  test::SyntheticWorld world;
  add_car(world, 10.0, 6.0);
  const StandingShape shape = shape_of(seen(world), box_at(10.0, 6.0, kCarSize));
  EXPECT_GT(shape.voxels, 150U);
  EXPECT_NEAR(shape.top_m, 1.45, 0.15);
  EXPECT_EQ(shape.tall_share, 0.0);
  EXPECT_EQ(shape.ring_ratio, 0.0);
  EXPECT_LT(shape.skirt_share, 0.3);
  EXPECT_EQ(shape_of(seen(world), box_at(30.0, -20.0, kCarSize)).voxels, 0U);
}

TEST(ObstacleMap, MeasuresHeightsOverTheGroundAndForgetsIt) {
  const std::vector<Eigen::Vector3f> points{{5.0F, 0.0F, -1.0F},  {5.0F, 0.02F, -1.0F},
                                            {6.0F, 0.0F, -1.78F}, {7.0F, 0.0F, 3.0F},
                                            {36.0F, 0.0F, 0.0F},  {8.0F, 0.0F, -1.0F}};
  const ObstacleMap obstacles =
      all_of({reduce_obstacles(points, {0, 0, 0, 0, 0, 1}, Floor(), sensor_at(100.0, 50.0))});
  const auto found = obstacles.around({105.0, 50.0}, 40.0);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_TRUE(found[0]->position.isApprox(Eigen::Vector3f(105.0F, 50.01F, 0.8F), 1e-4F));
  EXPECT_EQ(found[0]->scans, 1U);
}

class JudgeStanding : public testing::Test {
 protected:
  JudgeStanding() {
    add_car(world_, 10.0, 6.0);
    for (std::size_t i = 0; i < 20; ++i) {
      DetectedScan scan;
      scan.T_map_lidar = sensor_at(static_cast<double>(i), 0.0);
      scan.stamp_ns = static_cast<std::int64_t>(i) * 100'000'000;
      scans_.push_back(scan);
    }
  }
  void judge(const BoxRayCounter& count_rays) {
    ObstacleStore obstacles(folder_.path());
    for (const ScanObstacles& scan : scans_of(world_)) obstacles.add(0, scan);
    obstacles.finish();
    judge_standing(fused_, obstacles, scans_, count_rays, Eigen::Vector3d::Zero());
  }

  const test::TemporaryFolder folder_;
  test::SyntheticWorld world_;
  std::vector<DetectedScan> scans_;
  FusedObjects fused_;
};

TEST_F(JudgeStanding, TakesADoubtfulCarAndDropsWhatIsNone) {
  fused_.doubtful = {object_of(box_at(10.0, 6.0, kCarSize), maps::ObjectClass::kCar, 0.45)};
  maps::Box hedge = box_at(10.0, -6.0, kCarSize);
  add_hedge(world_, hedge);
  fused_.objects = {object_of(hedge, maps::ObjectClass::kCar)};
  judge([](std::size_t, const maps::Box&) { return BoxRays{.inside = 50}; });
  ASSERT_EQ(fused_.objects.size(), 1U);
  EXPECT_EQ(fused_.objects[0].placements[0].box.centre.y(), 6.0);
  EXPECT_EQ(fused_.objects[0].placements[0].box.track, 0);
  ASSERT_EQ(fused_.doubtful.size(), 1U);
}

TEST_F(JudgeStanding, KeepsAStandingPersonOnlyWhereThePlaceWasSeenFree) {
  const FusedObject person =
      object_of(box_at(10.0, 4.0, {0.6, 0.6, 1.7}), maps::ObjectClass::kPedestrian);
  fused_.objects = {person};
  judge([](std::size_t, const maps::Box&) { return BoxRays{.inside = 50}; });
  EXPECT_TRUE(fused_.objects.empty());
  fused_ = {};
  fused_.objects = {person};
  judge([](std::size_t scan, const maps::Box&) {
    return scan < 10 ? BoxRays{.inside = 50} : BoxRays{.through = 50};
  });
  EXPECT_EQ(fused_.objects.size(), 1U);
}

TEST_F(JudgeStanding, AsksTheObjectsOwnDriveOnly) {
  // Another day a lorry with a high load stands where the car stood.
  const maps::Box car = box_at(10.0, 6.0, kCarSize), lorry = box_at(10.6, 6.2, {7.0, 2.2, 3.0});
  test::SyntheticWorld other_day;
  other_day.boxes.push_back({{7.1, 5.1, 1.9}, {14.1, 7.3, 3.0}});
  for (const double x : {8.4, 9.8, 11.2})
    other_day.boxes.push_back({{x - 0.4, 5.1, 0.0}, {x + 0.4, 7.3, 0.9}});
  std::vector<ScanObstacles> of_both;
  ObstacleStore obstacles(folder_.path());
  for (const std::size_t drive : {0U, 1U}) {
    for (const ScanObstacles& scan : scans_of(drive == 0 ? world_ : other_day, 0.25)) {
      of_both.push_back(scan);
      obstacles.add(drive, scan);
    }
  }
  obstacles.finish();
  const FusedObject doubted = object_of(car, maps::ObjectClass::kCar, 0.2);
  // Both together look like no car.
  ASSERT_LT(vehicle_log_odds(doubted, shape_of(all_of(of_both), car), 20), 0.0);
  fused_.doubtful = {doubted};
  fused_.objects = {object_of(lorry, maps::ObjectClass::kTruck)};
  for (ObjectPlacement& placement : fused_.objects[0].placements) placement.scan += scans_.size();
  for (std::size_t i = 0; i < 20; ++i) {
    scans_.push_back(scans_[i]);
    scans_.back().drive = 1;
  }
  judge_standing(
      fused_, obstacles, scans_, [](std::size_t, const maps::Box&) { return BoxRays{}; },
      Eigen::Vector3d::Zero());
  EXPECT_EQ(fused_.objects.size(), 2U);
  EXPECT_TRUE(fused_.doubtful.empty());
}

TEST_F(JudgeStanding, LeavesWhatMovedAlone) {
  FusedObject moved = object_of(box_at(60.0, 30.0, {0.6, 0.6, 1.7}), maps::ObjectClass::kCyclist);
  moved.moving = true;
  fused_.objects = {moved};
  judge([](std::size_t, const maps::Box&) { return BoxRays{.inside = 50}; });
  EXPECT_EQ(fused_.objects.size(), 1U);
}

}  // namespace standing_verdict_test
}  // namespace stillmap::mapping
