#include "fusion/object_fusion.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "fusion/box_frames.hpp"
#include "support/matchers.hpp"
#include "support/synthetic_world.hpp"
#include "support/throws.hpp"

namespace stillmap::mapping {
namespace object_fusion_test {

using test::IsNearVector;
using test::ThrowsSaying;
using ::testing::Each;
using ::testing::Field;
using ::testing::IsEmpty;
using ::testing::SizeIs;

maps::Box car_at(double x, double y, double yaw_rad = 0.0) {
  maps::Box box;
  box.centre = {x, y, 0.75};
  box.size_m = {4.4, 1.8, 1.5};
  box.yaw_rad = yaw_rad;
  box.object_class = maps::ObjectClass::kCar;
  box.score = 0.9;
  return box;
}

/// A drive along x, a scan each 0.1 s, among boxes whose places are known: the ray counter is the
/// formula.
class Street {
 public:
  /// Metres of way from scan to scan, and where the first scan is.
  explicit Street(std::size_t scans, double step_m = 1.0, double first_x = 0.0) {
    add_drive(scans, step_m, first_x);
  }

  void add_drive(std::size_t scans, double step_m = 1.0, double first_x = 0.0) {
    const std::size_t drive = scans_.empty() ? 0 : scans_.back().drive + 1;
    for (std::size_t i = 0; i < scans; ++i) {
      DetectedScan scan;
      scan.drive = drive;
      scan.stamp_ns = static_cast<std::int64_t>(i) * 100'000'000;
      scan.T_map_lidar = test::pose_at(first_x + step_m * static_cast<double>(i), 0.0, 0.3);
      scans_.push_back(scan);
    }
    truth_.resize(scans_.size());
  }

  /// Something stands there in a scan. @param detected  with this box, or not at all.
  void put(std::size_t scan, const maps::Box& box_map,
           const std::optional<maps::Box>& detected_map) {
    truth_[scan].push_back(box_map);
    if (detected_map) detect(scan, *detected_map);
  }
  void put(std::size_t scan, const maps::Box& box_map) { put(scan, box_map, box_map); }
  void detect(std::size_t scan, const maps::Box& box_map) {
    scans_[scan].boxes.push_back(to_lidar(box_map, scans_[scan].T_map_lidar));
  }

  [[nodiscard]] BoxRayCounter counter() const {
    return [this](std::size_t scan, const maps::Box& box_lidar) {
      ++queries;
      const maps::Box box = to_map(box_lidar, scans_[scan].T_map_lidar);
      if ((box.centre - scans_[scan].T_map_lidar.translation()).norm() > 60.0) return BoxRays{};
      for (const maps::Box& truth : truth_[scan]) {
        if (overlap_of(truth, box).of_smaller > 0.3) return BoxRays{100, 0, 0};
      }
      return BoxRays{0, 100, 0};
    };
  }
  [[nodiscard]] FusedObjects fused() const { return fuse_boxes(scans_, counter()); }
  [[nodiscard]] std::vector<FusedObject> objects() const { return fused().objects; }
  [[nodiscard]] const std::vector<DetectedScan>& scans() const { return scans_; }

  mutable std::size_t queries = 0;

 private:
  std::vector<DetectedScan> scans_;
  std::vector<std::vector<maps::Box>> truth_;
};

std::vector<std::size_t> scans_of(const FusedObject& object) {
  std::vector<std::size_t> scans;
  for (const ObjectPlacement& placement : object.placements) scans.push_back(placement.scan);
  return scans;
}

std::vector<std::size_t> range(std::size_t begin, std::size_t end) {
  std::vector<std::size_t> all;
  for (std::size_t i = begin; i < end; ++i) all.push_back(i);
  return all;
}

double heading_error_rad(double a, double b) {
  return std::abs(std::remainder(a - b, std::numbers::pi));
}

TEST(ObjectFusion, MakesOneObjectOfAParkedCarSeenInManyScans) {
  Street street(30);
  for (std::size_t i = 0; i < 30; ++i) street.put(i, car_at(15.0, 3.0, 0.2));
  const auto objects = street.objects();
  ASSERT_THAT(objects, SizeIs(1));
  const FusedObject& car = objects[0];
  EXPECT_FALSE(car.moving);
  EXPECT_EQ(car.object_class, maps::ObjectClass::kCar);
  EXPECT_THAT(car.size_m, IsNearVector(Eigen::Vector3d(4.4, 1.8, 1.5), 1e-9));
  EXPECT_GT(car.existence, 0.95);
  EXPECT_LE(car.existence, 1.0);
  EXPECT_EQ(scans_of(car), range(0, 30));
  for (const ObjectPlacement& placement : car.placements) {
    EXPECT_TRUE(placement.detected);
    EXPECT_EQ(placement.box.track, 0);
    EXPECT_THAT(placement.box.centre, IsNearVector(Eigen::Vector3d(15.0, 3.0, 0.75), 1e-9));
    EXPECT_NEAR(placement.box.yaw_rad, 0.2, 1e-9);
  }
}

TEST(ObjectFusion, TakesEachSideFromTheScansThatFacedIt) {
  Street street(40);
  const maps::Box truth = car_at(20.0, 3.0);
  for (std::size_t i = 0; i < 40; ++i) {
    // Half of the car is seen: the rear one from behind, the front one from ahead.
    maps::Box seen = truth;
    seen.size_m.x() = 3.0;
    seen.centre.x() += i < 20 ? -0.7 : 0.7;
    street.put(i, truth, seen);
  }
  const auto objects = street.objects();
  ASSERT_THAT(objects, SizeIs(1));
  EXPECT_FALSE(objects[0].moving);
  EXPECT_NEAR(objects[0].size_m.x(), 4.4, 0.05);
  EXPECT_NEAR(objects[0].placements[0].box.centre.x(), 20.0, 0.05);
}

TEST(ObjectFusion, TakesTheHeadingOfMostHitsModuloHalfATurn) {
  Street street(30);
  for (std::size_t i = 0; i < 30; ++i) {
    maps::Box seen = car_at(15.0, 3.0, 0.3 + (i % 2 == 0 ? std::numbers::pi : 0.0));
    if (i % 10 == 0) {
      // Taken for a rear, so length and width are mixed up.
      seen.yaw_rad += 0.5 * std::numbers::pi;
    }
    street.put(i, car_at(15.0, 3.0, 0.3), seen);
  }
  const auto objects = street.objects();
  ASSERT_THAT(objects, SizeIs(1));
  EXPECT_LT(heading_error_rad(objects[0].placements[0].box.yaw_rad, 0.3), 0.02);
  EXPECT_NEAR(objects[0].size_m.x(), 4.4, 0.1);
}

TEST(ObjectFusion, DoesNotTakeJitterForMotion) {
  test::Random random(7);
  Street street(60);
  for (std::size_t i = 0; i < 60; ++i) {
    street.put(
        i, car_at(30.0, 3.0),
        car_at(30.0 + 0.5 * random.normal(), 3.0 + 0.3 * random.normal(), 0.05 * random.normal()));
  }
  const auto objects = street.objects();
  ASSERT_THAT(objects, SizeIs(1));
  EXPECT_FALSE(objects[0].moving);
  EXPECT_THAT(objects[0].placements[0].box.centre.head<2>(),
              IsNearVector(Eigen::Vector2d(30.0, 3.0), 0.2));
}

TEST(ObjectFusion, KeepsARowOfJitteringCarsAMetreApartAsMany) {
  test::Random random(3);
  Street street(60);
  for (std::size_t i = 0; i < 60; ++i) {
    for (int k = 0; k < 8; ++k) {
      const maps::Box truth = car_at(10.0 + 5.4 * k, 3.0);
      maps::Box seen = truth;
      seen.centre.x() += 0.35 * random.normal();
      seen.centre.y() += 0.2 * random.normal();
      const bool missed = random.uniform() < 0.2;
      street.put(i, truth, missed ? std::nullopt : std::optional(seen));
    }
  }
  const auto objects = street.objects();
  ASSERT_THAT(objects, SizeIs(8));
  EXPECT_THAT(objects, Each(Field(&FusedObject::moving, false)));
  for (const FusedObject& object : objects) {
    const double slot = (object.placements[0].box.centre.x() - 10.0) / 5.4;
    EXPECT_NEAR(slot, std::round(slot), 0.06);
  }
}

TEST(ObjectFusion, FillsTheScansThatMissedAParkedCar) {
  Street street(40);
  const maps::Box car = car_at(20.0, 3.0);
  for (std::size_t i = 0; i < 40; ++i) {
    const bool detected = i >= 4 && i < 38 && i % 4 != 0;
    street.put(i, car, detected ? std::optional(car) : std::nullopt);
  }
  const auto objects = street.objects();
  ASSERT_THAT(objects, SizeIs(1));
  // Before the first box and after the last one too.
  EXPECT_EQ(scans_of(objects[0]), range(0, 40));
  for (const ObjectPlacement& placement : objects[0].placements) {
    const std::size_t i = placement.scan;
    EXPECT_EQ(placement.detected, i >= 4 && i < 38 && i % 4 != 0) << i;
    EXPECT_THAT(placement.box.centre, IsNearVector(car.centre, 1e-9));
  }
}

TEST(ObjectFusion, ParkedCarsStayOnlyUntilTheirPlaceIsSeenFree) {
  Street street(40);
  const maps::Box car = car_at(20.0, 3.0);
  for (std::size_t i = 8; i < 31; ++i) {
    street.put(i, car, i >= 12 && i < 27 ? std::optional(car) : std::nullopt);
  }
  const auto objects = street.objects();
  ASSERT_THAT(objects, SizeIs(1));
  EXPECT_EQ(scans_of(objects[0]), range(8, 31));
}

TEST(ObjectFusion, LeavesOutScansTooFarForAnyPoint) {
  Street street(200);
  const maps::Box car = car_at(100.0, 3.0);
  for (std::size_t i = 0; i < 200; ++i)
    street.put(i, car, i >= 80 && i < 120 ? std::optional(car) : std::nullopt);
  const auto objects = street.objects();
  ASSERT_THAT(objects, SizeIs(1));
  EXPECT_EQ(scans_of(objects[0]), range(41, 160));
}

TEST(ObjectFusion, DoubtsBoxesThatFewOfManyGoodViewsHave) {
  Street street(40);
  const maps::Box hedge = car_at(20.0, 3.0);
  for (std::size_t i = 0; i < 40; ++i) {
    const bool detected = i == 11 || i == 12 || i == 13 || i == 25;
    street.put(i, hedge, detected ? std::optional(hedge) : std::nullopt);
  }
  const FusedObjects fused = street.fused();
  EXPECT_THAT(fused.objects, IsEmpty());
  ASSERT_THAT(fused.doubtful, SizeIs(1));
  EXPECT_LT(fused.doubtful[0].existence, 0.5);
}

TEST(ObjectFusion, DoubtsBoxesThatRaysGoThrough) {
  Street street(40);
  for (std::size_t i = 0; i < 40; i += 3) street.detect(i, car_at(20.0, 3.0));
  EXPECT_THAT(street.objects(), IsEmpty());
}

TEST(ObjectFusion, BelievesScoresByTheirSize) {
  const auto with_score = [](double score) {
    Street street(12);
    maps::Box car = car_at(6.0, 3.0);
    car.score = score;
    for (std::size_t i = 0; i < 12; ++i) street.put(i, car);
    const FusedObjects fused = street.fused();
    return (fused.objects.empty() ? fused.doubtful : fused.objects).at(0).existence;
  };
  EXPECT_LT(with_score(0.3), with_score(0.6));
  EXPECT_LT(with_score(0.6), with_score(0.9));
  EXPECT_LT(with_score(0.3), 0.5);
  EXPECT_GT(with_score(0.9), 0.5);
}

TEST(ObjectFusion, FollowsAMovingCarThroughMissedScans) {
  Street street(40, 0.0, 20.0);
  const auto at = [](std::size_t i) { return car_at(1.0 * static_cast<double>(i), 4.0); };
  for (std::size_t i = 5; i < 30; ++i) {
    const bool missed = i == 12 || i == 13 || i == 14 || i == 20;
    street.put(i, at(i), missed ? std::nullopt : std::optional(at(i)));
  }
  const auto objects = street.objects();
  ASSERT_THAT(objects, SizeIs(1));
  EXPECT_TRUE(objects[0].moving);
  // Before and after, its way was free.
  EXPECT_EQ(scans_of(objects[0]), range(5, 30));
  for (const ObjectPlacement& placement : objects[0].placements) {
    EXPECT_THAT(placement.box.centre, IsNearVector(at(placement.scan).centre, 0.02))
        << placement.scan;
    EXPECT_NEAR(placement.box.yaw_rad, 0.0, 0.02);
  }
}

TEST(ObjectFusion, MovingCarsGoOnForAFewScans) {
  Street street(40, 0.0, 20.0);
  const auto at = [](std::size_t i) { return car_at(1.0 * static_cast<double>(i), 4.0); };
  for (std::size_t i = 0; i < 40; ++i)
    street.put(i, at(i), i >= 10 && i < 25 ? std::optional(at(i)) : std::nullopt);
  const auto objects = street.objects();
  ASSERT_THAT(objects, SizeIs(1));
  EXPECT_EQ(scans_of(objects[0]), range(7, 28));
  EXPECT_THAT(objects[0].placements.front().box.centre, IsNearVector(at(7).centre, 0.05));
  EXPECT_THAT(objects[0].placements.back().box.centre, IsNearVector(at(27).centre, 0.05));
}

TEST(ObjectFusion, TurnsWithAMovingCar) {
  Street street(60, 0.0, 10.0);
  constexpr double kRadiusM = 15.0;
  const auto at = [](std::size_t i) {
    const double angle = 0.05 * static_cast<double>(i);
    return car_at(10.0 + kRadiusM * std::sin(angle), 5.0 + kRadiusM * (1.0 - std::cos(angle)),
                  angle);
  };
  for (std::size_t i = 0; i < 30; ++i) street.put(i, at(i));
  const auto objects = street.objects();
  ASSERT_THAT(objects, SizeIs(1));
  for (const ObjectPlacement& placement : objects[0].placements) {
    if (placement.scan >= 30) continue;
    EXPECT_LT(heading_error_rad(placement.box.yaw_rad, at(placement.scan).yaw_rad), 0.1);
    EXPECT_LT((placement.box.centre - at(placement.scan).centre).norm(), 0.2);
  }
}

TEST(ObjectFusion, KeepsCrossingObjectsApart) {
  Street street(40, 0.0, 20.0);
  for (std::size_t i = 0; i < 40; ++i) {
    const double t = 0.8 * static_cast<double>(i);
    street.put(i, car_at(4.0 + t, 10.0));
    maps::Box crossing = car_at(20.0, t - 9.0, 0.5 * std::numbers::pi);
    street.put(i, crossing);
  }
  const auto objects = street.objects();
  ASSERT_THAT(objects, SizeIs(2));
  for (const FusedObject& object : objects) {
    EXPECT_TRUE(object.moving);
    EXPECT_EQ(scans_of(object), range(0, 40));
    const Eigen::Vector3d way =
        object.placements.back().box.centre - object.placements.front().box.centre;
    EXPECT_NEAR(way.head<2>().cwiseAbs().maxCoeff(), 0.8 * 39, 0.2);
    EXPECT_NEAR(way.head<2>().cwiseAbs().minCoeff(), 0.0, 0.2);
  }
}

TEST(ObjectFusion, ACarThatParksAndLeavesIsOneObject) {
  Street street(90, 0.0, 20.0);
  const auto at = [](std::size_t i) {
    const double t = 0.1 * static_cast<double>(i);
    const double stop = 10.0 + 9.0 * std::min(t, 2.0) - 0.0;
    const double go = t > 6.0 ? 9.0 * (t - 6.0) : 0.0;
    return car_at(stop + go, 4.0);
  };
  for (std::size_t i = 0; i < 90; ++i) street.put(i, at(i));
  const auto objects = street.objects();
  ASSERT_THAT(objects, SizeIs(1));
  EXPECT_TRUE(objects[0].moving);
  EXPECT_EQ(scans_of(objects[0]), range(0, 90));
  for (const ObjectPlacement& placement : objects[0].placements)
    EXPECT_LT((placement.box.centre - at(placement.scan).centre).norm(), 0.8) << placement.scan;
}

TEST(ObjectFusion, AMovingCarThatStopsIsFilledWhereItStands) {
  Street street(60, 0.0, 20.0);
  const auto at = [](std::size_t i) {
    return car_at(std::min(1.0 * static_cast<double>(i), 15.0), 4.0);
  };
  for (std::size_t i = 0; i < 60; ++i)
    street.put(i, at(i), i < 30 ? std::optional(at(i)) : std::nullopt);
  const auto objects = street.objects();
  ASSERT_THAT(objects, SizeIs(1));
  EXPECT_EQ(scans_of(objects[0]), range(0, 60));
  EXPECT_THAT(objects[0].placements.back().box.centre, IsNearVector(at(59).centre, 0.1));
}

TEST(ObjectFusion, UsesGivenNumbersAsTheyAre) {
  Street street(20);
  for (std::size_t i = 0; i < 20; ++i) {
    // Two that stand in one another, one that is seen through: numbers are believed.
    maps::Box first = car_at(10.0, 3.0), second = car_at(10.5, 3.0);
    first.track = 7;
    second.track = 3;
    first.score = second.score = 1.0;
    street.detect(i, first);
    street.detect(i, second);
  }
  const auto objects = street.objects();
  ASSERT_THAT(objects, SizeIs(2));
  for (const FusedObject& object : objects) {
    EXPECT_FALSE(object.moving);
    EXPECT_EQ(object.existence, 1.0);
    EXPECT_EQ(scans_of(object), range(0, 20));
  }
}

TEST(ObjectFusion, GivenMovingBoxesStayExactlyWhereTheyWere) {
  Street street(20, 0.0, 10.0);
  const auto at = [](std::size_t i) {
    maps::Box box = car_at(1.3 * static_cast<double>(i), 4.0, 0.1 * static_cast<double>(i % 3));
    box.track = 5;
    box.score = 1.0;
    return box;
  };
  for (std::size_t i = 0; i < 20; ++i) street.put(i, at(i));
  const auto objects = street.objects();
  ASSERT_THAT(objects, SizeIs(1));
  ASSERT_EQ(scans_of(objects[0]), range(0, 20));
  for (const ObjectPlacement& placement : objects[0].placements) {
    EXPECT_THAT(placement.box.centre, IsNearVector(at(placement.scan).centre, 1e-9));
    EXPECT_NEAR(placement.box.yaw_rad, at(placement.scan).yaw_rad, 1e-9);
  }
}

TEST(ObjectFusion, ParkedCarsOfOneDayAreNoneOfTheOther) {
  Street street(30);
  street.add_drive(30);
  for (std::size_t i = 0; i < 30; ++i) street.put(i, car_at(15.0, 3.0));
  for (std::size_t i = 30; i < 60; ++i) street.put(i, car_at(22.0, -3.0));
  const auto objects = street.objects();
  ASSERT_THAT(objects, SizeIs(2));
  EXPECT_EQ(scans_of(objects[0]), range(0, 30));
  EXPECT_EQ(scans_of(objects[1]), range(30, 60));
}

TEST(ObjectFusion, ThePlaceSeenFreeOnAnotherDaySpeaksForAnObject) {
  const auto existence = [](bool second_day) {
    Street street(16);
    for (std::size_t i = 0; i < 16; ++i) {
      street.put(i, car_at(8.0, 3.0), i % 2 == 0 ? std::optional(car_at(8.0, 3.0)) : std::nullopt);
    }
    if (second_day) street.add_drive(16);
    const FusedObjects fused = street.fused();
    return (fused.objects.empty() ? fused.doubtful : fused.objects).at(0).existence;
  };
  EXPECT_GT(existence(true), existence(false) + 0.1);
}

TEST(ObjectFusion, FindsNothingInNothing) {
  const Street street(3);
  EXPECT_THAT(street.objects(), IsEmpty());
  EXPECT_THAT(fuse_boxes({}, street.counter()).objects, IsEmpty());
}

TEST(ObjectFusion, RefusesBoxesAndPosesThatAreNotFinite) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  const auto refused = [](const auto& spoil) {
    Street street(3);
    street.detect(1, car_at(3.0, 2.0));
    std::vector<DetectedScan> scans = street.scans();
    spoil(scans[1]);
    EXPECT_THAT([&] { static_cast<void>(fuse_boxes(scans, street.counter())); },
                ThrowsSaying<std::invalid_argument>({"scan 1"}));
  };
  refused([](DetectedScan& scan) { scan.boxes[0].centre.x() = kNan; });
  refused([](DetectedScan& scan) { scan.boxes[0].yaw_rad = kNan; });
  refused([](DetectedScan& scan) { scan.boxes[0].size_m.y() = kNan; });
  refused([](DetectedScan& scan) { scan.boxes[0].size_m.y() = 0.0; });
  refused([](DetectedScan& scan) { scan.boxes[0].score = kNan; });
  refused([](DetectedScan& scan) { scan.boxes[0].score = 1.5; });
  refused([](DetectedScan& scan) { scan.T_map_lidar.translation().y() = kNan; });
}

TEST(ObjectFusion, SameInputGivesTheSameBits) {
  test::Random random(11);
  Street street(50);
  for (std::size_t i = 0; i < 50; ++i) {
    for (int k = 0; k < 5; ++k) {
      street.put(i, car_at(8.0 * k, 3.0),
                 car_at(8.0 * k + 0.4 * random.normal(), 3.0 + 0.4 * random.normal()));
    }
    street.put(i, car_at(0.7 * static_cast<double>(i), -3.0));
  }
  const auto once = street.objects(), again = street.objects();
  ASSERT_EQ(once.size(), again.size());
  for (std::size_t i = 0; i < once.size(); ++i) {
    EXPECT_EQ(once[i].existence, again[i].existence);
    ASSERT_EQ(once[i].placements.size(), again[i].placements.size());
    for (std::size_t k = 0; k < once[i].placements.size(); ++k) {
      EXPECT_EQ(once[i].placements[k].box.centre, again[i].placements[k].box.centre);
      EXPECT_EQ(once[i].placements[k].box.yaw_rad, again[i].placements[k].box.yaw_rad);
    }
  }
}

TEST(ObjectFusion, AsksOnlyScansNearAPlace) {
  // Ten times the way with ten times the cars must not ask a hundred times as often.
  const auto queries = [](std::size_t scans) {
    Street street(scans, 2.0);
    for (std::size_t i = 0; i < scans; ++i) {
      for (std::size_t k = 0; k * 20 < 2 * scans; ++k) {
        const maps::Box car = car_at(20.0 * static_cast<double>(k), 3.0);
        const double distance_m = std::abs(2.0 * static_cast<double>(i) - car.centre.x());
        if (distance_m < 60.0)
          street.put(i, car, distance_m < 40.0 ? std::optional(car) : std::nullopt);
      }
    }
    EXPECT_EQ(street.objects().size(), (scans + 9) / 10);
    return street.queries;
  };
  EXPECT_LT(queries(600), 20 * queries(60));
}

}  // namespace object_fusion_test
}  // namespace stillmap::mapping
