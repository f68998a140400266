#include <cmath>
#include <numbers>

#include "bodies.hpp"
#include "random.hpp"
#include "street.hpp"
#include "world.hpp"

namespace stillmap::simulation {
namespace {

using std::numbers::pi;

constexpr std::uint32_t kLabelCar = 10;
constexpr std::uint32_t kLabelPerson = 30;
constexpr std::uint32_t kLabelMovingCar = 252;
constexpr std::uint32_t kLabelMovingPerson = 254;
// The street goes on beyond the sensor's reach in front of and behind the drive.
constexpr double kBeyond = 125.0;

/// A range of shapes, and where in World::shapes it lies.
struct Shapes {
  std::vector<std::size_t> indices;
  std::vector<maps::ObjectClass> classes;
};

Shapes add_bodies(World& world, std::vector<Body> bodies) {
  Shapes shapes;
  for (Body& body : bodies) {
    shapes.indices.push_back(world.shapes.size());
    shapes.classes.push_back(body.object_class);
    world.shapes.push_back(std::move(body.mesh));
  }
  return shapes;
}

Actor actor_of(const Shapes& shapes, Random& random) {
  const std::size_t kind = random.index(shapes.indices.size());
  Actor actor;
  actor.shape = shapes.indices[kind];
  actor.object_class = shapes.classes[kind];
  return actor;
}

std::uint64_t day_key(const WorldSpec& spec, Stream stream, std::uint64_t number) {
  return key_of({spec.seed, static_cast<std::uint64_t>(spec.day),
                 static_cast<std::uint64_t>(stream), number});
}

void park_vehicles(World& world, const WorldSpec& spec, const Shapes& vehicles) {
  constexpr double kSlot = 6.2;
  constexpr double kOccupied = 0.6;
  for (const double side : {1.0, -1.0}) {
    Random random(day_key(spec, Stream::kParked, side > 0.0 ? 1 : 2));
    for (double s = world.road.begin_m() + 4.0; s < world.road.end_m() - 4.0; s += kSlot) {
      Actor actor = actor_of(vehicles, random);
      actor.label = kLabelCar;
      actor.s_m = s + random.uniform(-0.4, 0.4);
      actor.d_m = side * (StreetSection::kParkingMiddle + random.uniform(-0.15, 0.1));
      // Right-hand traffic: most park in the direction of their side.
      const bool against = random.chance(0.1) != (side > 0.0);
      actor.yaw_rad = random.uniform(-0.03, 0.03) + (against ? pi : 0.0);
      if (random.chance(kOccupied)) world.actors.push_back(actor);
    }
  }
}

/// A column of vehicles on one lane, all equally fast so that none runs into the next.
void add_lane(World& world, const WorldSpec& spec, const Shapes& vehicles, double speed_mps) {
  const bool ours = speed_mps > 0.0;
  Random random(day_key(spec, Stream::kTraffic, ours ? 1 : 2));
  const double travel = std::abs(speed_mps) * spec.duration_s;
  const double begin = world.road.begin_m() - (ours ? travel : 0.0);
  const double end = world.road.end_m() + (ours ? 0.0 : travel);
  for (double s = begin; s < end; s += random.uniform(18.0, 70.0)) {
    Actor actor = actor_of(vehicles, random);
    actor.label = kLabelMovingCar;
    actor.s_m = s;
    actor.speed_mps = speed_mps;
    actor.d_m = (ours ? -1.0 : 1.0) * StreetSection::kLaneMiddle + random.uniform(-0.2, 0.2);
    actor.yaw_rad = ours ? 0.0 : pi;
    // Our own place on our lane stays free, whatever the small differences in speed add up to.
    const bool is_ours = ours && s > -14.0 && s < 14.0;
    if (!is_ours) world.actors.push_back(actor);
  }
}

void add_walkers(World& world, const WorldSpec& spec, const Shapes& persons) {
  Random random(day_key(spec, Stream::kWalkers, 0));
  for (double s = world.road.begin_m() + 5.0; s < world.road.end_m() - 5.0;
       s += random.uniform(8.0, 30.0)) {
    Actor actor = actor_of(persons, random);
    const bool stands = random.chance(0.25);
    actor.label = stands ? kLabelPerson : kLabelMovingPerson;
    actor.s_m = s;
    actor.speed_mps = stands ? 0.0 : random.sign() * random.uniform(0.9, 1.6);
    actor.d_m = random.sign() * random.uniform(6.5, 7.2);
    actor.yaw_rad = actor.speed_mps < 0.0 ? pi : 0.0;
    world.actors.push_back(actor);
  }
}

}  // namespace

World make_town(const WorldSpec& spec) {
  World world{.road = Road(spec.seed, -kBeyond, spec.length_m + kBeyond),
              .ground_and_buildings = {},
              .shapes = make_plants(spec.seed),
              .plants = {},
              .actors = {}};
  add_ground(world.ground_and_buildings, world.road, spec.seed);
  add_houses(world.ground_and_buildings, world.road, spec.seed);
  add_poles(world.ground_and_buildings, world.road, spec.seed);
  std::vector<std::size_t> trees;
  std::vector<std::size_t> bushes;
  for (std::size_t i = 0; i < world.shapes.size(); ++i) {
    (i < world.shapes.size() / 2 ? trees : bushes).push_back(i);
  }
  world.plants = place_plants(world.road, spec.seed, trees, bushes);
  const Shapes vehicles = add_bodies(world, make_vehicles());
  const Shapes persons = add_bodies(world, make_persons());
  park_vehicles(world, spec, vehicles);
  add_lane(world, spec, vehicles, spec.length_m / spec.duration_s);
  add_lane(world, spec, vehicles, -8.5);
  add_walkers(world, spec, persons);
  return world;
}

Eigen::Isometry3d T_world_actor(const World& world, const Actor& actor, double time_s) {
  return world.road.T_world_ground(actor.s_at(time_s), actor.d_m, actor.yaw_rad);
}

}  // namespace stillmap::simulation
