#include <cmath>

#include "geometry/random.hpp"
#include "scenarios/scenario.hpp"

namespace stillmap::simulation {

Plan plan_highway(const WorldSpec& spec) {
  constexpr double kSpan = 400.0;
  constexpr double kOwnSpeed = 27.0;
  Plan plan;
  Random random(key_of(spec.seed, Stream::kRoad));
  RoadSection section;
  section.lanes = random.chance(0.5) ? 2 : 3;
  section.lane_width = 3.6;
  section.median = random.uniform(2.5, 4.5);
  section.shoulder = 2.5;
  section.kerb_height = 0.0;
  section.pavement_width = 0.0;
  plan.network = std::make_shared<RoadNetwork>();
  const double way = kOwnSpeed * spec.duration_s;
  std::vector<std::size_t> nodes{plan.network->add_node(Eigen::Vector2d::Zero())};
  double heading = 0.0;
  Eigen::Vector2d at = Eigen::Vector2d::Zero();
  // A kilometre of road behind and before the drive.
  for (double length = 0.0; length < way + 1400.0; length += kSpan) {
    const double next = 0.6 * heading + random.uniform(-0.16, 0.16);
    const double middle = 0.5 * (heading + next);
    at += kSpan * Eigen::Vector2d(std::cos(middle), std::sin(middle));
    nodes.push_back(plan.network->add_node(at));
    plan.network->add_edge(nodes[nodes.size() - 2], nodes.back(), {heading, next}, section);
    heading = next;
  }
  plan.network->finish();
  plan.relief = {.max_grade = 0.04, .hill_length_m = 700.0, .dip_m = 0.03};
  plan.traffic = {.spacing_m = 75.0,
                  .speed_mps = 30.0,
                  .speed_spread_mps = 5.0,
                  .mix = {},
                  .overtakes = true,
                  .own_speed_mps = kOwnSpeed};
  plan.traffic.mix = {{BodyKind::kSmallCar, 2},
                      {BodyKind::kSaloon, 4},
                      {BodyKind::kEstate, 4},
                      {BodyKind::kSuv, 3},
                      {BodyKind::kVan, 2},
                      {BodyKind::kTruck, 1.5},
                      {BodyKind::kArticulatedTruck, 4},
                      {BodyKind::kMotorcyclist, 0.3},
                      {BodyKind::kBus, 0.3}};
  plan.parked_share = 0.0;
  plan.walkers_per_100_m = 0.0;
  plan.own_route = make_route(*plan.network, legs_through(*plan.network, nodes), section.lanes - 1);
  plan.own_route.start_m = 500.0;
  return plan;
}

}  // namespace stillmap::simulation
