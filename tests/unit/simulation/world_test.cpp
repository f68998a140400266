#include "scenarios/world.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <set>

#include "geometry/random.hpp"
#include "roads/route.hpp"
#include "roads/traffic.hpp"
#include "scenarios/scenario.hpp"
#include "sensing/ego_motion.hpp"
#include "sensing/scanner.hpp"
#include "small_world.hpp"

namespace stillmap::simulation {
namespace world_test {

WorldSpec short_drive(const std::string& scenario, std::uint64_t seed = 1) {
  return {.scenario = scenario,
          .seed = seed,
          .day = 1,
          .change = false,
          .duration_s = 6.0,
          .reach_m = 60.0};
}

TEST(RoadNetwork, GivesPlacesOnAStraightRoad) {
  const World world = small_world::flat_world(0.0);
  const RoadEdge& edge = world.network->edges().front();
  EXPECT_NEAR(edge.length_m(), 400.0, 1e-9);
  EXPECT_NEAR(edge.half_width(0), 4.3, 1e-12);
  const auto place = world.network->place({30.0, 6.0});
  ASSERT_TRUE(place);
  EXPECT_NEAR(place->station_m, 230.0, 1e-6);
  EXPECT_NEAR(place->offset_m, 6.0, 1e-9);
  EXPECT_NEAR(place->outside_m, 1.7, 1e-9);
  EXPECT_NEAR(world.network->place({30.0, -1.0})->offset_m, -1.0, 1e-9);
}

TEST(Terrain, HasACrownAKerbAndAPavement) {
  const World world = small_world::flat_world(0.0);
  const RoadSection& section = world.network->edges().front().section;
  // Kerbs vary along the street; here they have their mean height (station 7 * 9 * pi).
  const double x = 63.0 * std::numbers::pi - 200.0;
  const auto height = [&](double y) { return world.terrain->height({x, y}); };
  const double edge = 4.3;
  EXPECT_NEAR(height(edge - 0.001), 0.0, 1e-3);
  EXPECT_NEAR(height(edge + Terrain::kKerbWidth), section.kerb_height, 1e-6);
  EXPECT_NEAR(height(edge + Terrain::kKerbWidth + 1.0), section.kerb_height + 0.02, 1e-6);
  EXPECT_GT(height(0.0), 0.06);
  EXPECT_LT(height(0.0), 0.11);
  EXPECT_NEAR(height(3.0), height(-3.0), 1e-9);
}

TEST(Terrain, NoRoadIsSteeperThanItsRelief) {
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    const World world = make_world(short_drive("town", seed));
    for (double t = 0.0; t < 6.0; t += 0.5) {
      const Motion& own = world.own_motion;
      const Eigen::Vector2d a = own.path->point(own.station(t));
      const Eigen::Vector2d b = own.path->point(own.station(t) + 2.0);
      // A tenth, and the dips.
      EXPECT_LT(std::abs(world.terrain->height(b) - world.terrain->height(a)) / (b - a).norm(),
                0.125);
    }
  }
}

TEST(Ground, IsWhereTheTerrainSaysAndHasNoHoles) {
  for (const std::string scenario : {"town", "highway", "depot"}) {
    const World world = make_world(short_drive(scenario));
    const MeshScene ground(world.ground);
    Random random(3);
    const Eigen::Vector2d middle = world.own_motion.point(3.0);
    for (int i = 0; i < 3000; ++i) {
      const Eigen::Vector2d p =
          middle + Eigen::Vector2d(random.uniform(-30, 30), random.uniform(-30, 30));
      const double z = world.terrain->height(p);
      const Ray down{.origin = Eigen::Vector3d(p.x(), p.y(), z + 5.0).cast<float>(),
                     .direction = -Eigen::Vector3f::UnitZ(),
                     .max_range_m = 10.0F};
      const std::optional<Hit> hit = ground.cast(down);
      ASSERT_TRUE(hit) << scenario << " has a hole at " << p.transpose();
      // Roughness of gardens, the kerb's slope, and 1 m cells on a curved surface.
      EXPECT_NEAR(5.0 - hit->range_m, 0.0, 0.16) << scenario << " at " << p.transpose();
    }
  }
}

TEST(Path, KeepsStraightLinesAndIsSmoothInTurns) {
  const Path straight({{0.0, 0.0}, {50.0, 0.0}});
  EXPECT_NEAR(straight.length_m(), 50.0, 1e-9);
  EXPECT_NEAR((straight.point(20.25) - Eigen::Vector2d(20.25, 0.0)).norm(), 0.0, 1e-9);
  std::vector<Eigen::Vector2d> circle;
  for (int i = 0; i <= 200; ++i) {
    const double a = 0.01 * std::numbers::pi * i;
    circle.emplace_back(20.0 * std::cos(a), 20.0 * std::sin(a));
  }
  const Path turn(circle);
  for (double s = 20.0; s < 100.0; s += 0.37) {
    EXPECT_NEAR(turn.curvature(s), 1.0 / 20.0, 1e-3);
    EXPECT_NEAR(turn.point(s).norm(), 20.0, 0.15);
  }
}

/// Gap between two rectangles on the ground along their nearest axis, roughly: centres less halves.
TEST(Traffic, KeepsItsDistanceAndStaysOnItsSide) {
  for (const std::string scenario : {"town", "city", "highway"}) {
    WorldSpec spec = short_drive(scenario);
    spec.duration_s = 40.0;
    const World world = make_world(spec);
    std::size_t moving = 0;
    for (double t = 0.0; t <= spec.duration_s; t += 1.0) {
      const Eigen::Vector2d own = world.own_motion.point(t);
      const double heading = world.own_motion.heading_rad(t);
      for (const Actor& actor : world.actors) {
        if (!actor.motion || !actor.motion->covers(t) || actor.wheelbase_m == 0.0) continue;
        ++moving;
        const Eigen::Vector2d to = actor.motion->point(t) - own;
        const double x = std::cos(heading) * to.x() + std::sin(heading) * to.y();
        const double y = -std::sin(heading) * to.x() + std::cos(heading) * to.y();
        EXPECT_FALSE(std::abs(x) < 3.5 && std::abs(y) < 1.3)
            << scenario << ": a vehicle inside ours at " << t << " s: " << x << " " << y;
        EXPECT_LT(actor.motion->speed_mps(t), 45.0);
        EXPECT_GT(actor.motion->speed_mps(t), -0.5);
      }
    }
    EXPECT_GT(moving, 100U);
  }
}

TEST(City, IsDrivenAlongEveryStreetBetweenCrossingsAndNeverTurnsRound) {
  WorldSpec spec = short_drive("city");
  spec.duration_s = 3000.0;
  const Plan plan = plan_city(spec);
  const std::vector<StopLine>& stops = plan.own_route.stops;
  // Rows and columns, and from each to the next.
  constexpr std::size_t kRound = 2 * (kCityRows + 1) * (kCityRows - 1);
  ASSERT_GT(stops.size(), kRound + 1);
  std::set<std::size_t> driven;
  for (std::size_t i = 0; i < kRound; ++i) {
    driven.insert(stops[i].edge);
    EXPECT_NE(stops[i].edge, stops[i + 1].edge);
  }
  EXPECT_EQ(driven.size(), 2 * kCityRows * (kCityRows - 1));
  EXPECT_EQ(stops[kRound].edge, stops[0].edge);
  EXPECT_EQ(stops[kRound].node, stops[0].node);
  const double round_m = stops[kRound].station_m - stops[0].station_m;
  EXPECT_GT(round_m, 18'000.0);
  EXPECT_LT(round_m, 21'000.0);
  EXPECT_LT((plan.own_route.path->point(stops[kRound].station_m) -
             plan.own_route.path->point(stops[0].station_m))
                .norm(),
            1.0);
}

TEST(City, HasTrafficAroundUsThatComesAndGoesOutOfSight) {
  constexpr double kDuration = 400.0;
  constexpr double kSight = 120.0;
  WorldSpec spec = short_drive("city");
  spec.duration_s = kDuration;
  const Plan plan = plan_city(spec);
  const std::vector<Driven> driven = drive_traffic(*plan.network, plan.own_route, plan.traffic,
                                                   {.duration_s = kDuration, .key = 3});
  const Motion& own = driven.front().motion;
  std::size_t met = 0;
  for (std::size_t i = 1; i < driven.size(); ++i) {
    const Motion& motion = driven[i].motion;
    const auto away = [&](double t) { return (motion.point(t) - own.point(t)).norm(); };
    if (motion.begin_s > -0.9) {
      EXPECT_GT(away(motion.begin_s), kSight);
    }
    const double end_s = std::min(motion.end_s(), kDuration);
    if (end_s < kDuration) {
      EXPECT_GT(away(end_s), kSight);
    }
    for (double t = 0.0; t <= kDuration; t += 10.0) met += motion.covers(t) && away(t) < kSight;
  }
  // Five at a time.
  EXPECT_GT(met, 200U);
  // Not one for each place in all the streets.
  EXPECT_LT(driven.size(), 2000U);
}

TEST(Town, IsDrivenTwiceAndInBothDirectionsAndLoopsMeet) {
  WorldSpec spec = short_drive("town");
  spec.duration_s = 300.0;
  const World world = make_world(spec);
  const EgoMotion ego(world, 1.73);
  int same = 0;
  int opposite = 0;
  for (double t = 0.0; t < 300.0; t += 1.0) {
    const Eigen::Vector2d a = world.own_motion.point(t);
    bool again = false;
    bool back = false;
    for (double later = t + 40.0; later < 300.0; later += 0.25) {
      const Eigen::Vector2d b = world.own_motion.point(later);
      if ((a - b).norm() > 4.0) continue;
      // Of one lane, or of the two beside each other: as high, but for the road's slope.
      EXPECT_LT(std::abs(ego.T_world_lidar(t).translation().z() -
                         ego.T_world_lidar(later).translation().z()),
                0.13 * (a - b).norm() + 0.1);
      const double turn =
          std::cos(world.own_motion.heading_rad(t) - world.own_motion.heading_rad(later));
      again = again || turn > 0.95;
      back = back || turn < -0.95;
    }
    same += again ? 1 : 0;
    opposite += back ? 1 : 0;
  }
  EXPECT_GT(same, 4);
  EXPECT_GT(opposite, 5);
}

TEST(Days, LeaveWhatStaysAndChangeWhatMoves) {
  WorldSpec spec = short_drive("town");
  const World today = make_world(spec);
  spec.day = 2;
  const World tomorrow = make_world(spec);
  ASSERT_EQ(today.buildings.vertices.size(), tomorrow.buildings.vertices.size());
  EXPECT_TRUE(today.buildings.vertices == tomorrow.buildings.vertices);
  const auto parked = [](const World& world) {
    std::vector<Eigen::Vector3d> places;
    for (const Actor& actor : world.actors) {
      if (!actor.motion) places.emplace_back(actor.T_world_body.translation());
    }
    return places;
  };
  EXPECT_FALSE(parked(today) == parked(tomorrow));
  spec.day = 1;
  spec.change = true;
  const World changed = make_world(spec);
  EXPECT_TRUE(changed.buildings.triangles.size() != today.buildings.triangles.size() ||
              changed.placements.size() != today.placements.size());
}

TEST(Busy, WorldsHaveMoreTwoWheelersAndPeopleThatStandApart) {
  WorldSpec spec = short_drive("town");
  const auto count = [](const World& world, maps::ObjectClass kind, bool moves) {
    return std::ranges::count_if(world.actors, [&](const Actor& actor) {
      return actor.object_class == kind && actor.moves() == moves;
    });
  };
  const World usual = make_world(spec);
  spec.busy = true;
  const World busy = make_world(spec);
  for (const auto kind : {maps::ObjectClass::kMotorcycle, maps::ObjectClass::kPedestrian}) {
    for (const bool moves : {false, true})
      EXPECT_GT(2 * count(busy, kind, moves), 3 * count(usual, kind, moves));
  }
  EXPECT_GT(busy.placements.size(), usual.placements.size() + 20);
  // Nobody stands in a parked car.
  for (const Actor& person : busy.actors) {
    if (person.object_class != maps::ObjectClass::kPedestrian || person.moves()) continue;
    for (const Actor& car : busy.actors) {
      if (car.object_class != maps::ObjectClass::kCar || car.moves()) continue;
      const Eigen::Vector3d p = car.T_world_body.inverse() * person.T_world_body.translation();
      EXPECT_FALSE(std::abs(p.x()) < 1.5 && std::abs(p.y()) < 0.7);
    }
  }
}

TEST(Days, HowLongOneDrivesDoesNotChangeTheWorld) {
  WorldSpec spec = short_drive("town");
  const World brief = make_world(spec);
  spec.duration_s = 12.0;
  const World longer = make_world(spec);
  const Eigen::Vector2d here = brief.own_motion.point(1.0);
  Random random(5);
  for (int i = 0; i < 500; ++i) {
    const Eigen::Vector2d p =
        here + Eigen::Vector2d(random.uniform(-20, 20), random.uniform(-20, 20));
    EXPECT_EQ(brief.terrain->height(p), longer.terrain->height(p));
  }
  for (double t = 0.0; t < 5.0; t += 0.5) {
    EXPECT_LT((brief.own_motion.point(t) - longer.own_motion.point(t)).norm(), 1e-6);
  }
}

/// Seen without noise: on its body at the point's own time, and for what stands in the box of its
/// scan once deskewed.
TEST(Boxes, ContainTheirPointsToACentimetre) {
  for (const std::string scenario : {"town", "depot"}) {
    const World world = make_world(short_drive(scenario));
    std::vector<Beam> beams;
    for (int ring = 0; ring < 40; ++ring) {
      for (int column = 0; column < 900; ++column) {
        const double azimuth = 2.0 * std::numbers::pi * (0.5 - column / 900.0);
        const double elevation = 0.03 - 0.011 * ring;
        beams.push_back({.direction = Eigen::Vector3d(std::cos(elevation) * std::cos(azimuth),
                                                      std::cos(elevation) * std::sin(azimuth),
                                                      std::sin(elevation))
                                          .cast<float>(),
                         .time_s = static_cast<float>(0.1 * (column / 900.0 - 0.5)),
                         .ring = 0});
      }
    }
    small_world::ExactSensor sensor(beams);
    const EgoMotion ego(world, 1.73);
    Scanner scanner(world, ego, sensor, {.key = 1, .behind = true});
    const SimulatedScan scan = scanner.take(20);
    std::map<int, maps::Box> boxes;
    for (const maps::Box& box : scan.boxes_at_stamp) boxes[box.track] = box;
    std::size_t checked = 0;
    for (std::size_t i = 0; i < scan.points.size(); ++i) {
      const auto track = static_cast<int>(scan.points.labels[i] >> kInstanceShift);
      if (track == 0) continue;
      const Actor& actor = world.actors[static_cast<std::size_t>(track) - 1];
      const double at = scan.stamp_s + static_cast<double>(scan.points.time_offsets_s[i]);
      const Eigen::Vector3d p_world =
          ego.T_world_lidar(at) * scan.points.positions[i].cast<double>();
      const Mesh& mesh = world.bodies[actor.body].postures[posture_of(world, actor, scan.stamp_s)];
      const Eigen::Vector3d p_body = T_world_actor(world, actor, at).inverse() * p_world;
      EXPECT_LT(mesh.bounds().cast<double>().exteriorDistance(p_body), 0.01);
      ++checked;
      if (actor.motion) continue;
      EXPECT_TRUE(
          boxes.at(track).contains(ego.T_world_lidar(scan.stamp_s).inverse() * p_world, 0.01))
          << scenario << " track " << track;
    }
    EXPECT_GT(checked, 300U) << scenario;
  }
}

TEST(EgoMotion, EveryCarrierHoldsTheLidarWhereItIsMounted) {
  const World world = make_world(short_drive("town"));
  Eigen::Isometry3d T_usual_lidar = Eigen::Isometry3d::Identity();
  T_usual_lidar.translate(Eigen::Vector3d(0.2, -0.1, 0.05))
      .rotate(Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitY()));
  for (const Carrier carrier : {Carrier::kVehicle, Carrier::kFast, Carrier::kHand}) {
    const EgoMotion usual(world, 1.73, carrier), mounted(world, 1.73, carrier, T_usual_lidar);
    EXPECT_TRUE(mounted.T_world_lidar(1.0).isApprox(usual.T_world_lidar(1.0) * T_usual_lidar));
  }
}

}  // namespace world_test
}  // namespace stillmap::simulation
