#include "scenarios/world.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "geometry/random.hpp"
#include "scenarios/scenario.hpp"

namespace stillmap::simulation {
namespace {

Plan plan_of(const WorldSpec& spec) {
  if (spec.scenario == "town") return plan_town(spec);
  if (spec.scenario == "city") return plan_city(spec);
  if (spec.scenario == "highway") return plan_highway(spec);
  if (spec.scenario == "depot") return plan_depot(spec);
  throw std::invalid_argument(
      fmt::format("scenario: found \"{}\", expected one of {}", spec.scenario, scenario_names()));
}

/// Points of our way, some metres apart.
std::vector<Eigen::Vector2d> way_points(const Motion& own) {
  constexpr double kEvery = 8.0;
  std::vector<Eigen::Vector2d> points;
  for (double s = own.stations_m.front(); s < own.stations_m.back() + kEvery; s += kEvery) {
    points.push_back(own.path->point(s));
  }
  return points;
}

/// Beside the lane [m], to the right of its middle: in the parking strip or on the pavement.
constexpr double kBesideLaneM = 2.9;
/// What is parked nearer to us than this would stand in our vehicle [m].
constexpr double kOwnRoomM = 5.5;

/// Traffic behaves as if we drove; nobody meets us beside the lane.
void stand_beside_lane(Motion& own) {
  const double station_m = own.station(0.0);
  std::fill(own.stations_m.begin(), own.stations_m.end(), station_m);
  std::fill(own.offsets_m.begin(), own.offsets_m.end(), -kBesideLaneM);
}

void furnish(World& world, const Plan& plan, const WorldSpec& spec) {
  Scenery scenery(world, spec.seed);
  if (spec.scenario == "town" || spec.scenario == "city") {
    build_plots(scenery, plan, spec);
    furnish_streets(scenery, plan, spec);
  } else if (spec.scenario == "highway") {
    furnish_highway(scenery, plan, spec);
  } else {
    furnish_depot(scenery, plan, spec);
  }
  if (spec.busy) add_lookalikes(scenery, plan);
}

/// The same vehicle in every world: an estate of the measures of KITTI's (4.77 x 1.82 m, and 1.46 m
/// high), with two antennas on the roof behind the sensor.
Body make_own_body() {
  const Eigen::Vector3f size(4.77F, 1.82F, 1.46F);
  Random random(key_of(0, Stream::kBodies));
  Body body = make_body(BodyKind::kEstate, random);
  Mesh& mesh = body.postures.front();
  const Eigen::Vector3f scale = size.cwiseQuotient(mesh.bounds().sizes());
  for (Eigen::Vector3f& vertex : mesh.vertices) vertex = vertex.cwiseProduct(scale);
  for (const double y : {-0.38, 0.38}) {
    mesh.add_box(Eigen::Isometry3d::Identity(), {-1.3, y - 0.09, 1.4}, {-1.1, y + 0.09, 1.53},
                 Surface::kTrim);
  }
  return body;
}

}  // namespace

std::string scenario_names() { return "town city highway depot"; }

bool is_scenario(const std::string& name) {
  return name == "town" || name == "city" || name == "highway" || name == "depot";
}

World make_world(const WorldSpec& spec) {
  Plan plan = plan_of(spec);
  if (spec.parked_share) plan.parked_share = *spec.parked_share;
  if (spec.busy) make_busy(plan);
  std::vector<Driven> driven = drive_traffic(*plan.network, plan.own_route, plan.traffic,
                                             {.duration_s = spec.duration_s,
                                              .key = day_key(spec, Stream::kTraffic),
                                              .cancel = spec.cancel});
  World world;
  world.own_motion = std::move(driven.front().motion);
  driven.erase(driven.begin());
  if (spec.standing) stand_beside_lane(world.own_motion);
  world.terrain = std::make_unique<Terrain>(*plan.network, plan.relief, spec.seed,
                                            way_points(world.own_motion), spec.reach_m + 5.0);
  world.ground = make_ground(*world.terrain, *plan.network, plan.cover, spec.seed);
  world.network = plan.network;
  const Route& route = plan.own_route;
  // Where we are at time 0 on any day, but for decimetres: motions begin a second earlier.
  const double start_m = route.start_m + plan.traffic.own_speed_mps;
  world.T_world_start =
      world.terrain->T_world_upright(route.path->point(start_m), route.path->heading_rad(start_m));
  furnish(world, plan, spec);
  world.own_body = make_own_body();
  park_vehicles(world, plan, spec);
  if (spec.busy) add_crowd(world, plan, spec);
  if (spec.standing) {
    std::erase_if(world.actors, [own = world.own_motion.point(0.0)](const Actor& actor) {
      return (actor.T_world_body.translation().head<2>() - own).norm() < kOwnRoomM;
    });
  }
  add_traffic(world, spec, std::move(driven));
  add_walkers(world, plan, spec);
  return world;
}

Eigen::Isometry3d T_world_actor(const World& world, const Actor& actor, double time_s) {
  if (!actor.motion) return actor.T_world_body;
  const Eigen::Vector2d p = actor.motion->point(time_s);
  const double heading = actor.motion->heading_rad(time_s);
  if (actor.wheelbase_m == 0.0) return world.terrain->T_world_upright(p, heading);
  return world.terrain->T_world_standing(p, heading, actor.wheelbase_m, actor.track_m);
}

std::size_t posture_of(const World& world, const Actor& actor, double time_s) {
  const Body& body = world.bodies[actor.body];
  if (body.postures.size() == 1 || !actor.motion) return 0;
  if (std::abs(actor.motion->speed_mps(time_s)) < 0.1) return 0;
  const double strides = actor.motion->station(time_s) / body.stride_m;
  const auto phases = static_cast<double>(body.postures.size() - 1);
  return 1 + static_cast<std::size_t>((strides - std::floor(strides)) * phases);
}

}  // namespace stillmap::simulation
