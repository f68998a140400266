#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>

#include "geometry/random.hpp"
#include "sensing/echo.hpp"
#include "small_world.hpp"

namespace stillmap::simulation {
namespace rays_test {

using small_world::ExactSensor;
using small_world::flat_world;

Mesh upright_wall(double x, double half_width, Surface surface) {
  Mesh mesh;
  mesh.add_quad({x, -half_width, -1.0}, {x, half_width, -1.0}, {x, half_width, 5.0},
                {x, -half_width, 5.0}, surface);
  return mesh;
}

Beam ahead(float time_s = 0.0F) {
  return {.direction = Eigen::Vector3f::UnitX(), .time_s = time_s};
}

Actor parked(World& world, Mesh mesh, const Eigen::Vector3d& at, std::uint32_t label) {
  world.bodies.push_back({.kind = BodyKind::kSaloon,
                          .object_class = maps::ObjectClass::kCar,
                          .postures = {std::move(mesh)},
                          .stride_m = 0.0});
  Actor actor;
  actor.body = world.bodies.size() - 1;
  actor.label = label;
  actor.T_world_body.translation() = at;
  return actor;
}

TEST(Rays, MeetAWallAtItsDistanceAndIncidence) {
  World world = flat_world(0.0);
  world.buildings = upright_wall(12.5, 20.0, Surface::kWall);
  RayScene scene(world);
  scene.place_actors(0.0, 0.1, Eigen::Vector3d::Zero(), 50.0);
  Ray ray{
      .origin = {0.0F, 0.0F, 1.0F}, .direction = Eigen::Vector3f::UnitX(), .max_range_m = 100.0F};
  const Hits straight = scene.cast(ray);
  ASSERT_TRUE(straight.fixed);
  EXPECT_NEAR(straight.fixed->range_m, 12.5, 1e-5);
  EXPECT_NEAR(straight.fixed->cos_incidence, 1.0, 1e-6);
  EXPECT_EQ(straight.fixed->material.surface, Surface::kWall);
  EXPECT_FALSE(straight.movable);
  ray.direction = Eigen::Vector3f(1.0F, 1.0F, 0.0F).normalized();
  const Hits slanted = scene.cast(ray);
  ASSERT_TRUE(slanted.fixed);
  EXPECT_NEAR(slanted.fixed->range_m, 12.5 * std::numbers::sqrt2, 1e-4);
  EXPECT_NEAR(slanted.fixed->cos_incidence, 1.0 / std::numbers::sqrt2, 1e-5);
}

TEST(Rays, AnObjectIsMetWhereItIsAtTheRaysTime) {
  World world = flat_world(0.0);
  Mesh plate;
  plate.add_box(Eigen::Isometry3d::Identity(), {-0.5, -2.0, 0.0}, {0.5, 2.0, 3.0}, Surface::kPaint);
  Actor actor = parked(world, plate, {0.0, 0.0, 0.0}, 252);
  // At x = 20 at time 0, going on at 10 m/s: its rear is at 19.5, and at 20.5 a tenth later.
  actor.motion = small_world::straight_motion(20.0 - 10.0 - 1.0, 0.0, 10.0, 3.0);
  world.actors.push_back(actor);
  RayScene scene(world);
  scene.place_actors(0.0, 0.1, Eigen::Vector3d::Zero(), 50.0);
  for (const float share : {0.0F, 0.5F, 1.0F}) {
    const Hits hits = scene.cast({.origin = {0.0F, 0.0F, 1.0F},
                                  .direction = Eigen::Vector3f::UnitX(),
                                  .max_range_m = 100.0F,
                                  .share = share});
    ASSERT_TRUE(hits.movable);
    EXPECT_NEAR(hits.movable->range_m, 19.5 + static_cast<double>(share), 2e-3);
    EXPECT_EQ(hits.movable->actor, 0U);
  }
}

TEST(Rays, GoThroughGlassAndComeBackFromWhatIsBehindOrNotAtAll) {
  constexpr int kPanes = 800;
  World world = flat_world(0.0);
  for (int i = 0; i < kPanes; ++i) {
    const double y = 0.02 * i;
    world.buildings.add_quad({10.0, y, -1.0}, {10.0, y + 0.02, -1.0}, {10.0, y + 0.02, 5.0},
                             {10.0, y, 5.0}, Surface::kWindow);
  }
  world.buildings.add(upright_wall(11.0, 30.0, Surface::kWall), Eigen::Isometry3d::Identity());
  RayScene scene(world);
  SensorProperties sensor;
  sensor.range_noise_m = 0.0;
  sensor.half_range_m = 1e6;
  sensor.divergence_rad = 0.0;
  int behind = 0;
  int alike = 0;
  for (int i = 0; i < kPanes; ++i) {
    const Ray ray{.origin = {0.0F, static_cast<float>(0.02 * i + 0.01), 1.0F},
                  .direction = Eigen::Vector3f::UnitX(),
                  .max_range_m = 100.0F};
    const Hits first = scene.cast(ray);
    std::array<bool, 2> through{};
    for (std::uint64_t k = 0; k < 2; ++k) {
      const RayOutcome outcome = follow_ray(world, scene, sensor, ray, first, true,
                                            Random(key_of({k, static_cast<std::uint64_t>(i)})));
      // A few shots are lost anyhow.
      const double range = outcome.echo ? outcome.echo->range_m : 10.0;
      EXPECT_TRUE(std::abs(range - 10.0) < 1e-3 || std::abs(range - 11.0) < 1e-3) << range;
      through.at(k) = range > 10.5;
    }
    behind += through[0] ? 1 : 0;
    alike += through[0] == through[1] ? 1 : 0;
  }
  const double share = properties_of(Surface::kWindow).transmission;
  // Five deviations of a binomial. A pane lets all of its rays through, or nearly none.
  EXPECT_NEAR(behind / static_cast<double>(kPanes), share,
              5.0 * std::sqrt(share * (1 - share) / kPanes));
  EXPECT_GT(alike, 0.95 * kPanes);
}

TEST(Rays, WhatIsFarAndDarkComesBackLessOften) {
  World world = flat_world(0.0);
  RayScene scene(world);
  const SensorProperties sensor;
  const auto share = [&](double range, Surface surface) {
    int back = 0;
    for (std::uint64_t i = 0; i < 2000; ++i) {
      const Hits hits{.fixed = Hit{range, 1.0, surface, std::nullopt}, .movable = std::nullopt};
      if (follow_ray(world, scene, sensor, Ray{}, hits, true, Random(i)).echo) ++back;
    }
    return back / 2000.0;
  };
  EXPECT_GT(share(10.0, Surface::kAsphalt), 0.98);
  EXPECT_LT(share(90.0, Surface::kTyre), share(90.0, Surface::kAsphalt));
  EXPECT_LT(share(90.0, Surface::kAsphalt), share(30.0, Surface::kAsphalt));
  EXPECT_GT(share(90.0, Surface::kSign), 0.98);
}

TEST(Edges, ARangeBetweenTwoSurfacesOnlyWhereTheyAreTooNearToBeToldApart) {
  SensorProperties sensor;
  sensor.divergence_rad = 0.003;
  std::vector<Beam> beams;
  std::vector<std::optional<Echo>> near;
  for (int i = 0; i < 2000; ++i) {
    const double angle = 0.003 * i;
    beams.push_back(
        {.direction = Eigen::Vector3d(std::cos(angle), std::sin(angle), 0).cast<float>()});
    near.push_back(
        Echo{.range_m = i % 2 == 0 ? 10.0 : 10.4, .intensity = 0.3, .power = 0.003, .label = 50});
  }
  std::vector<std::optional<Echo>> far = near;
  for (std::size_t i = 1; i < far.size(); i += 2) far[i]->range_m = 14.0;
  mix_edges(near, beams, sensor, 1);
  mix_edges(far, beams, sensor, 1);
  int between = 0;
  for (std::size_t i = 0; i < near.size(); ++i) {
    if (near[i]->range_m > 10.0 && near[i]->range_m < 10.4) ++between;
    EXPECT_GE(near[i]->range_m, 10.0);
    EXPECT_LE(near[i]->range_m, 10.4);
    // Now and then neither is reported.
    EXPECT_TRUE(!far[i] || far[i]->range_m == 10.0 || far[i]->range_m == 14.0);
  }
  EXPECT_GT(between, 500);
}

/// Sweeps of a fan of beams, a millisecond apart, while we pass a pole at 10 m/s.
TEST(Scanner, APoleSeenFromAMovingSensorIsALineAgainOnceDeskewed) {
  World world = flat_world(10.0);
  world.buildings.add_column({0.0, 6.0, -0.3}, {0.0, 0.0, 6.0}, {0.05, 0.05}, Surface::kPole, 32);
  std::vector<Beam> beams;
  for (int k = -40; k <= 40; ++k) {
    const double t = 0.001 * k;
    // Towards where the pole is seen from there.
    for (int e = -3; e <= 6; ++e) {
      const Eigen::Vector3d to(-10.0 * t, 6.0, 0.3 * e);
      beams.push_back(
          {.direction = to.normalized().cast<float>(), .time_s = static_cast<float>(t)});
    }
  }
  ExactSensor sensor(beams);
  const EgoMotion ego(world, 1.73);
  Scanner scanner(world, ego, sensor, {.key = 1, .behind = true});
  const SimulatedScan scan = scanner.take(0);
  ASSERT_GT(scan.points.size(), 600U);
  double skewed = 0.0;
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    EXPECT_EQ(scan.points.labels[i], 80U);
    const Eigen::Vector3d p = scan.points.positions[i].cast<double>();
    const Eigen::Vector3d p_world =
        ego.T_world_lidar(scan.stamp_s + static_cast<double>(scan.points.time_offsets_s[i])) * p;
    EXPECT_NEAR((p_world.head<2>() - Eigen::Vector2d(0.0, 6.0)).norm(), 0.05, 2e-3);
    const Eigen::Vector3d as_if_at_once = ego.T_world_lidar(scan.stamp_s) * p;
    skewed = std::max(skewed, std::abs(as_if_at_once.x()));
  }
  // 40 ms at 10 m/s.
  EXPECT_NEAR(skewed, 0.4, 0.07);
}

TEST(Scanner, SaysWhatEachPointLiesOnAndWhatLiesBehindAnObject) {
  World world = flat_world(0.0);
  world.buildings = upright_wall(20.0, 30.0, Surface::kWall);
  Mesh car;
  car.add_box(Eigen::Isometry3d::Identity(), {-1.0, -1.0, 0.0}, {1.0, 1.0, 3.0}, Surface::kTrim);
  world.actors.push_back(parked(world, car, {10.0, 0.0, 0.0}, 10));
  ExactSensor sensor({ahead(), {.direction = Eigen::Vector3f(1.0F, 0.5F, 0.0F).normalized()}});
  const EgoMotion ego(world, 1.73);
  Scanner scanner(world, ego, sensor, {.key = 1, .behind = true});
  const SimulatedScan scan = scanner.take(0);
  ASSERT_EQ(scan.points.size(), 2U);
  EXPECT_EQ(scan.points.labels[0], 10U | (1U << kInstanceShift));
  EXPECT_NEAR(static_cast<double>(scan.points.positions[0].x()), 9.0, 1e-3);
  EXPECT_EQ(scan.points.labels[1], 50U);
  ASSERT_EQ(scan.behind.size(), 1U);
  EXPECT_EQ(scan.behind.labels[0], 50U);
  EXPECT_NEAR(static_cast<double>(scan.behind.positions[0].x()), 20.0, 1e-3);
  // The road's crown lifts our wheels, not the box at z = 0.
  const double sensor_z = ego.T_world_lidar(0.0).translation().z();
  ASSERT_EQ(scan.boxes.size(), 1U);
  EXPECT_EQ(scan.boxes[0].track, 1);
  EXPECT_NEAR((scan.boxes[0].centre - Eigen::Vector3d(10.0, 0.0, 1.5 - sensor_z)).norm(), 0.0,
              2e-3);
  EXPECT_NEAR((scan.boxes[0].size_m - Eigen::Vector3d(2.0, 2.0, 3.0)).norm(), 0.0, 1e-3);
}

TEST(Scanner, OurOwnVehicleIsSeenBeyondTheShortestRangeAndHidesWhatIsBehindIt) {
  World world = flat_world(0.0);
  // Down to the bonnet, 1.5 m ahead of the sensor and 0.83 m below it.
  const Eigen::Vector3f down = Eigen::Vector3f(1.5F, 0.0F, -0.83F).normalized();
  ExactSensor sensor({{.direction = down}});
  const EgoMotion ego(world, 1.73);
  {
    Scanner scanner(world, ego, sensor, {.key = 1, .behind = true});
    const SimulatedScan scan = scanner.take(0);
    ASSERT_EQ(scan.points.size(), 1U);
    EXPECT_EQ(scan.points.labels[0], 1U);
    EXPECT_NEAR(static_cast<double>(scan.points.positions[0].z()), -0.83, 1e-3);
  }
  sensor.change().min_range_m = 3.0;
  Scanner scanner(world, ego, sensor, {.key = 1, .behind = true});
  EXPECT_EQ(scanner.take(0).points.size(), 0U);
}

}  // namespace rays_test
}  // namespace stillmap::simulation
