#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "geometry/random.hpp"
#include "scenarios/scenario.hpp"
#include "scenery/furniture.hpp"
#include "scenery/plants.hpp"

/// What WorldSpec::busy adds: two-wheelers, people, and things that look like them or like cars.
namespace stillmap::simulation {
namespace {

using std::numbers::pi;

/// A road without a pavement has a verge this wide [m].
constexpr double kVerge = 1.5;

/// Parked two-wheelers, riders who wait, people who stand or cross the road.
class Crowd {
 public:
  Crowd(World& world, const WorldSpec& spec)
      : world_(world), spec_(spec), stock_(world, day_key(spec, Stream::kBodies, 3)) {}

  void add_along(const RoadEdge& edge, int side, Random& random) {
    const double pavement = std::max(kVerge, edge.section.pavement_width);
    for (double s = random.uniform(4.0, 20.0); s < edge.length_m() - 4.0;
         s += random.uniform(5.0, 30.0)) {
      park({&edge, side, s, pavement}, random);
    }
    for (double s = random.uniform(4.0, 20.0); s < edge.length_m() - 4.0;
         s += random.uniform(5.0, 30.0)) {
      const Place place{&edge, side, s, pavement};
      random.chance(0.25) ? cross(place, random) : gather(place, random);
    }
  }

 private:
  struct Place {
    const RoadEdge* edge;
    int side;
    double station_m;
    double pavement_m;
  };

  /// One by the wall or the kerb, or a row across: a rack.
  void park(const Place& at, Random& random) {
    const double u = random.uniform();
    BodyKind kind = random.chance(0.5) ? BodyKind::kMotorcycle : BodyKind::kBicycle;
    if (u < 0.4) {
      const double space =
          kind == BodyKind::kBicycle ? random.uniform(0.5, 0.9) : random.uniform(0.9, 1.4);
      const double out = random.chance(0.5) ? -1.1 : random.uniform(0.9, 1.2);
      const double turn = random.chance(0.5) ? 0.5 * pi : random.uniform(0.7, 1.4);
      const std::size_t count = 2 + random.index(5);
      for (std::size_t i = 0; i < count; ++i) {
        stand(stock_.draw(kind, random), at, space * static_cast<double>(i), out,
              turn + (random.chance(0.2) ? pi : 0.0) + random.uniform(-0.1, 0.1));
      }
    } else {
      const double out = u < 0.65 ? at.pavement_m - 0.35 : random.uniform(-0.9, 0.5);
      if (u > 0.85) kind = random.chance(0.6) ? BodyKind::kMotorcyclist : BodyKind::kCyclist;
      stand(stock_.draw(kind, random), at, 0.0, out,
            (random.chance(0.3) ? pi : 0.0) + random.uniform(-0.25, 0.25));
    }
  }

  /// Somebody alone or a group: on the pavement, or in the road beside parked cars.
  void gather(const Place& at, Random& random) {
    const double out =
        random.chance(0.3) ? random.uniform(-2.2, 0.0) : random.uniform(0.3, at.pavement_m);
    const std::size_t count = random.chance(0.5) ? 1 : 2 + random.index(4);
    for (std::size_t i = 0; i < count; ++i) {
      stand(stock_.draw(BodyKind::kPedestrian, random), at, random.uniform(-0.9, 0.9),
            out + random.uniform(-0.6, 0.6), random.uniform(0.0, 2.0 * pi));
    }
  }

  void cross(const Place& at, Random& random) {
    const double slant = random.uniform(-4.0, 4.0);
    const double across = std::min(1.2, at.pavement_m);
    const Eigen::Vector2d from = beside_road(*at.edge, at.side, at.station_m, across).point;
    const Eigen::Vector2d to =
        beside_road(*at.edge, 1 - at.side, at.station_m + slant, across).point;
    if (!world_.terrain->covers(from) || !world_.terrain->covers(to)) return;
    Motion motion{.path = std::make_shared<Path>(std::vector<Eigen::Vector2d>{from, to}),
                  .begin_s = -1.0,
                  .stations_m = {},
                  .offsets_m = {}};
    const double way = motion.path->length_m() - 0.1, speed = random.uniform(0.8, 1.9);
    const double starts_s = random.uniform(-way / speed, spec_.duration_s);
    for (double t = motion.begin_s; t <= spec_.duration_s + 1.0; t += Motion::kStep_s) {
      motion.stations_m.push_back(std::clamp(speed * (t - starts_s), 0.0, way));
      motion.offsets_m.push_back(0.0);
    }
    Actor actor = stock_.draw(BodyKind::kPedestrian, random);
    actor.label = label_of(BodyKind::kPedestrian, true);
    actor.motion = std::move(motion);
    world_.actors.push_back(std::move(actor));
  }

  /// @param turn  against the direction of the nearest lane [rad].
  void stand(Actor actor, const Place& at, double along_m, double out_m, double turn) {
    const RoadsideFrame beside = beside_road(*at.edge, at.side, at.station_m + along_m, out_m);
    if (!world_.terrain->covers(beside.point)) return;
    const double heading = beside.heading_rad + turn;
    actor.T_world_body = actor.wheelbase_m == 0.0
                             ? world_.terrain->T_world_upright(beside.point, heading)
                             : world_.terrain->T_world_standing(beside.point, heading,
                                                                actor.wheelbase_m, actor.track_m);
    if (is_free(actor)) world_.actors.push_back(std::move(actor));
  }

  [[nodiscard]] Eigen::Vector3d size_of(const Actor& actor) const {
    return world_.bodies[actor.body].postures.front().bounds().sizes().cast<double>();
  }

  /// Whether neither its middle nor its ends are in something that stands there.
  [[nodiscard]] bool is_free(const Actor& actor) const {
    constexpr double kRoom = 0.25;
    const double half = 0.5 * size_of(actor).x();
    return std::ranges::none_of(world_.actors, [&](const Actor& other) {
      if (other.moves()) return false;
      const Eigen::Isometry3d T = other.T_world_body.inverse() * actor.T_world_body;
      if (T.translation().norm() > 12.0) return false;
      const Eigen::Vector3d room = 0.5 * size_of(other) + Eigen::Vector3d::Constant(kRoom);
      return std::ranges::any_of(std::array{-half, 0.0, half}, [&](double x) {
        const Eigen::Vector3d p = T * Eigen::Vector3d(x, 0.0, 0.0);
        return std::abs(p.x()) < room.x() && std::abs(p.y()) < room.y();
      });
    });
  }

  World& world_;
  const WorldSpec& spec_;
  BodyStock stock_;
};

double sum_of(const std::vector<std::pair<BodyKind, double>>& mix) {
  double sum = 0.0;
  for (const auto& [kind, share] : mix) sum += share;
  return sum;
}

}  // namespace

void make_busy(Plan& plan) {
  const double others = sum_of(plan.traffic.mix);
  plan.traffic.mix.emplace_back(BodyKind::kMotorcyclist, 0.35 * others);
  // A highway has no pavements, and nobody cycles there.
  if (plan.walkers_per_100_m > 0.0) plan.traffic.mix.emplace_back(BodyKind::kCyclist, 0.2 * others);
  plan.walkers_per_100_m *= 2.0;
}

void add_crowd(World& world, const Plan& plan, const WorldSpec& spec) {
  if (plan.walkers_per_100_m <= 0.0) return;
  Crowd crowd(world, spec);
  for (std::size_t e = 0; e < world.network->edges().size(); ++e) {
    for (const int side : {0, 1}) {
      Random random(
          day_key(spec, Stream::kWalkers, 10'000 + 2 * e + static_cast<std::uint64_t>(side)));
      crowd.add_along(world.network->edges()[e], side, random);
    }
  }
}

void add_lookalikes(Scenery& scenery, const Plan& plan) {
  if (plan.walkers_per_100_m <= 0.0) return;
  const auto border = [](BorderKind kind, double length_m) {
    return [=](Random& r) { return make_border_piece(kind, length_m, r.uniform(0.6, 1.9), r); };
  };
  // Each as likely as the others.
  const std::vector<std::vector<std::size_t>> kinds{
      scenery.variants(3, 80, make_bollard),
      scenery.variants(4, 81, make_bin),
      scenery.variants(4, 82, make_cabinet),
      scenery.variants(3, 83, make_utility_pole),
      scenery.variants(4, 84, [](Random& r) { return make_bush(1.0, Random(r.bits())); }),
      scenery.variants(
          4, 85, [](Random& r) { return make_tree(TreeKind::kYoung, 1.0, Random(r.bits())); }),
      scenery.variants(4, 86, border(BorderKind::kHedge, 1.8)),
      scenery.variants(4, 87, border(BorderKind::kHedge, 4.2)),
      scenery.variants(4, 88, border(BorderKind::kWall, 1.8)),
      scenery.variants(4, 89, border(BorderKind::kWall, 4.2)),
      scenery.variants(3, 90, make_bench),
      scenery.variants(3, 91, make_traffic_sign),
  };
  for (std::size_t e = 0; e < plan.network->edges().size(); ++e) {
    const RoadEdge& edge = plan.network->edges()[e];
    for (const int side : {0, 1}) {
      Random random(key_of(scenery.seed(), Stream::kFurniture,
                           10'000 + 2 * e + static_cast<std::uint64_t>(side)));
      const double pavement = std::max(kVerge, edge.section.pavement_width);
      for (double s = random.uniform(4.0, 15.0); s < edge.length_m() - 6.0;
           s += random.uniform(3.0, 15.0)) {
        const auto& shapes = kinds[random.index(kinds.size())];
        const std::size_t count = random.chance(0.6) ? 1 : 1 + random.index(3);
        const double out = random.uniform(0.3, pavement + 0.3);
        // Long pieces begin here and reach away from the carriageway.
        const double turn = random.chance(0.5) ? 0.0 : random.uniform(0.0, pi);
        for (std::size_t i = 0; i < count; ++i) {
          const double station = s + random.uniform(0.7, 1.2) * static_cast<double>(i);
          const Eigen::Isometry3d T =
              T_world_roadside(*scenery.world().terrain, edge, side, station, out);
          scenery.place(shapes[random.index(shapes.size())],
                        T * Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitZ()),
                        random.uniform(0.7, 1.1));
        }
      }
    }
  }
}

}  // namespace stillmap::simulation
