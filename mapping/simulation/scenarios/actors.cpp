#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "geometry/random.hpp"
#include "scenarios/scenario.hpp"

namespace stillmap::simulation {
namespace {

using std::numbers::pi;

/// So many bodies of a kind are drawn; more would cost memory and show little.
std::size_t variants_of(BodyKind kind) {
  switch (kind) {
    case BodyKind::kSmallCar:
    case BodyKind::kSaloon:
    case BodyKind::kEstate:
    case BodyKind::kSuv:
      return 12;
    case BodyKind::kVan:
    case BodyKind::kPedestrian:
      return 10;
    default:
      return 4;
  }
}

/// Feet on the ground, from the size of the body.
void set_feet(Actor& actor, const Body& body) {
  const Eigen::Vector3f size = body.postures.front().bounds().sizes();
  actor.wheelbase_m = 0.6 * static_cast<double>(size.x());
  actor.track_m = 0.8 * static_cast<double>(size.y());
  if (body.kind == BodyKind::kPedestrian) actor.wheelbase_m = actor.track_m = 0.0;
}

}  // namespace

std::uint32_t label_of(BodyKind kind, bool moves) {
  switch (kind) {
    case BodyKind::kTruck:
    case BodyKind::kArticulatedTruck:
      return moves ? 258 : 18;
    case BodyKind::kBus:
      return moves ? 257 : 13;
    case BodyKind::kTrailer:
      return moves ? 259 : 20;
    case BodyKind::kMotorcycle:
      return 15;
    case BodyKind::kMotorcyclist:
      return moves ? 255 : 32;
    case BodyKind::kBicycle:
      return 11;
    case BodyKind::kCyclist:
      return moves ? 253 : 31;
    case BodyKind::kPedestrian:
      return moves ? 254 : 30;
    default:
      return moves ? 252 : 10;
  }
}

Actor BodyStock::draw(BodyKind kind, Random& random) {
  std::vector<std::size_t>& stock = bodies_[kind];
  if (stock.empty()) {
    for (std::size_t i = 0; i < variants_of(kind); ++i) {
      Random own(key_of({key_, static_cast<std::uint64_t>(kind), i}));
      stock.push_back(world_.bodies.size());
      world_.bodies.push_back(make_body(kind, own));
    }
  }
  Actor actor;
  actor.body = stock[random.index(stock.size())];
  const Body& body = world_.bodies[actor.body];
  actor.object_class = body.object_class;
  actor.label = label_of(kind, false);
  // Black, grey and white are the most common colours; at 905 nm many dark ones are brighter than
  // they look.
  actor.paint = std::clamp(
      0.25 + 1.5 * random.uniform() * random.uniform() + 0.6 * random.uniform(), 0.2, 1.9);
  set_feet(actor, body);
  return actor;
}

Actor BodyStock::draw(const std::vector<std::pair<BodyKind, double>>& mix, Random& random) {
  double sum = 0.0;
  for (const auto& [kind, share] : mix) sum += share;
  double at = random.uniform() * sum;
  for (const auto& [kind, share] : mix) {
    at -= share;
    if (at < 0.0) return draw(kind, random);
  }
  return draw(mix.front().first, random);
}

namespace {

/// Places along roads, and in drives.
class Parker {
 public:
  Parker(World& world, const Plan& plan, const WorldSpec& spec)
      : world_(world), plan_(plan), spec_(spec), stock_(world, day_key(spec, Stream::kBodies)) {}

  void park_along(std::size_t e, int side) {
    const RoadEdge& edge = world_.network->edges()[e];
    const ParkingKind kind = edge.section.parking.at(static_cast<std::size_t>(side));
    if (kind == ParkingKind::kNone) return;
    Random random(day_key(spec_, Stream::kParked, 2 * e + static_cast<std::uint64_t>(side)));
    const double share = std::clamp(plan_.parked_share + random.uniform(-0.25, 0.25), 0.0, 0.95);
    const double begin = world_.network->node_radius_m(edge.from) + 3.0;
    const double end = edge.length_m() - world_.network->node_radius_m(edge.to) - 3.0;
    const bool along = kind == ParkingKind::kParallel || kind == ParkingKind::kHalfOnPavement;
    const double slot = along ? 6.0 : (kind == ParkingKind::kAngled ? 3.3 : 2.6);
    for (double s = begin + 0.5 * slot; s < end; s += slot) {
      Random own(random.bits());
      if (own.chance(share)) park(edge, side, kind, s, own);
    }
  }

  void park_in_drives() {
    for (const Plot& plot : plan_.plots) {
      Random random(key_of({plot.key, static_cast<std::uint64_t>(spec_.day), 7}));
      if (!plot.drive_m || !random.chance(0.6)) continue;
      const RoadEdge& edge = world_.network->edges()[plot.edge];
      Actor actor = draw_fitting(5.4, random);
      const double out = edge.section.pavement_width + random.uniform(2.8, 4.5);
      stand(actor, edge, plot.side, *plot.drive_m, out,
            0.5 * pi * random.sign() + random.uniform(-0.05, 0.05));
    }
  }

  /// Bicycles stand by the houses, along the street or across the pavement.
  void park_bicycles(std::size_t e, int side) {
    const RoadEdge& edge = world_.network->edges()[e];
    Random random(day_key(spec_, Stream::kParked, 1000 + 2 * e + static_cast<std::uint64_t>(side)));
    const double out = edge.section.pavement_width - 0.4;
    for (double s = random.uniform(5.0, 60.0); s < edge.length_m() - 5.0;
         s += random.uniform(1.0, 60.0)) {
      Random own(random.bits());
      Actor actor = stock_.draw(BodyKind::kBicycle, own);
      const double turn = own.chance(0.6) ? 0.0 : own.uniform(0.8, 1.6);
      stand(actor, edge, side, s, out, turn + own.uniform(-0.15, 0.15));
    }
  }

  /// In a yard: in rows beside the lanes.
  void park_in_yard(std::size_t e, int side) {
    const RoadEdge& edge = world_.network->edges()[e];
    Random random(day_key(spec_, Stream::kParked, 2 * e + static_cast<std::uint64_t>(side)));
    const double begin = world_.network->node_radius_m(edge.from) + 6.0;
    const double end = edge.length_m() - world_.network->node_radius_m(edge.to) - 6.0;
    for (double s = begin; s < end;) {
      Random own(random.bits());
      Actor actor = stock_.draw(plan_.parked_mix, own);
      const double length = length_of(actor);
      const double width =
          static_cast<double>(world_.bodies[actor.body].postures.front().bounds().sizes().y());
      s += 0.5 * length + 0.5;
      if (s + 0.5 * length > end) break;
      const double heading = own.chance(0.5) ? pi : 0.0;
      if (own.chance(0.55))
        stand(actor, edge, side, s, -(0.5 * width + 0.5), heading + own.uniform(-0.06, 0.06));
      s += 0.5 * length + own.uniform(0.5, 6.0);
    }
  }

 private:
  [[nodiscard]] double length_of(const Actor& actor) const {
    return static_cast<double>(world_.bodies[actor.body].postures.front().bounds().sizes().x());
  }

  Actor draw_fitting(double room, Random& random) {
    for (int i = 0; i < 4; ++i) {
      Actor actor = stock_.draw(plan_.parked_mix, random);
      if (length_of(actor) <= room) return actor;
    }
    return stock_.draw(BodyKind::kSmallCar, random);
  }

  void park(const RoadEdge& edge, int side, ParkingKind kind, double s, Random& random) {
    constexpr double kAngle = 0.9;
    if (edge.has_drive(side, s)) return;
    const bool along = kind == ParkingKind::kParallel || kind == ParkingKind::kHalfOnPavement;
    Actor actor = draw_fitting(along ? 5.7 : 5.6, random);
    const double width =
        static_cast<double>(world_.bodies[actor.body].postures.front().bounds().sizes().y());
    double out = 0.0;
    double turn = random.chance(0.1) ? pi : 0.0;
    switch (kind) {
      case ParkingKind::kParallel:
        out = -(0.5 * width + random.uniform(0.1, 0.35));
        break;
      case ParkingKind::kHalfOnPavement:
        out = random.uniform(-0.35, -0.1);
        break;
      case ParkingKind::kAngled:
        out = -2.3 + random.uniform(-0.2, 0.2);
        turn = -kAngle;
        break;
      default:
        out = -(0.5 * length_of(actor) + random.uniform(0.2, 0.6));
        turn = random.chance(0.3) ? 0.5 * pi : -0.5 * pi;
    }
    stand(actor, edge, side, s + random.uniform(-0.15, 0.15), out,
          turn + random.uniform(-0.04, 0.04));
  }

  /// @param turn  against the direction of the nearest lane, counter-clockwise [rad].
  void stand(Actor& actor, const RoadEdge& edge, int side, double s, double out, double turn) {
    const RoadsideFrame beside = beside_road(edge, side, s, out);
    if (!world_.terrain->covers(beside.point)) return;
    actor.T_world_body = world_.terrain->T_world_standing(beside.point, beside.heading_rad + turn,
                                                          actor.wheelbase_m, actor.track_m);
    world_.actors.push_back(std::move(actor));
  }

  World& world_;
  const Plan& plan_;
  const WorldSpec& spec_;
  BodyStock stock_;
};

}  // namespace

void park_vehicles(World& world, const Plan& plan, const WorldSpec& spec) {
  if (plan.parked_mix.empty()) return;
  Parker parker(world, plan, spec);
  const bool yard = plan.plots.empty();
  for (std::size_t e = 0; e < world.network->edges().size(); ++e) {
    for (const int side : {0, 1}) {
      if (yard) {
        parker.park_in_yard(e, side);
      } else {
        parker.park_along(e, side);
        parker.park_bicycles(e, side);
      }
    }
  }
  parker.park_in_drives();
}

void add_traffic(World& world, const WorldSpec& spec, std::vector<Driven> driven) {
  constexpr double kMoves = 0.5;
  BodyStock stock(world, day_key(spec, Stream::kBodies, 1));
  for (Driven& d : driven) {
    Random random(d.key);
    Actor actor = stock.draw(d.kind, random);
    const double way = d.motion.stations_m.back() - d.motion.stations_m.front();
    actor.label = label_of(d.kind, way > kMoves);
    actor.motion = std::move(d.motion);
    world.actors.push_back(std::move(actor));
  }
}

namespace {

/// While somebody walks [s].
struct Span {
  double begin_s;
  double end_s;
};

/// People on the pavements.
class Walkers {
 public:
  Walkers(World& world, const Plan& plan, const WorldSpec& spec)
      : world_(world),
        vicinity_m_(plan.traffic.vicinity_m),
        whole_{-1.0, spec.duration_s + 1.0},
        stock_(world, day_key(spec, Stream::kBodies, 2)) {
    for (double t = whole_.begin_s; vicinity_m_ > 0.0 && t <= whole_.end_s; t += 1.0)
      way_.push_back(world.own_motion.point(t));
  }

  /// Somebody who starts from here; where there is traffic in our vicinity only, another one each
  /// time that we come near.
  void add(const RoadEdge& edge, int side, double s, std::uint64_t bits) {
    if (vicinity_m_ <= 0.0) {
      add(edge, side, s, whole_, bits, true);
      return;
    }
    const Eigen::Vector2d here = edge.point(s);
    std::uint64_t number = 0;
    for (std::size_t i = 0; i < way_.size(); ++i) {
      const std::size_t first = i;
      while (i < way_.size() && (way_[i] - here).norm() < vicinity_m_) ++i;
      if (i == first) continue;
      const Span span{whole_.begin_s + static_cast<double>(first),
                      std::min(whole_.begin_s + static_cast<double>(i), whole_.end_s)};
      // Who stands here does so all the time.
      add(edge, side, s, span, key_of({bits, number}), number == 0);
      ++number;
    }
  }

 private:
  void add(const RoadEdge& edge, int side, double s, const Span& span, std::uint64_t bits,
           bool may_stand) {
    Random own(bits);
    const double out = own.uniform(0.5, std::max(0.6, edge.section.pavement_width - 0.4));
    const bool stands = own.chance(0.2);
    const bool forward = own.chance(0.5);
    const double speed = own.uniform(0.9, 1.7);
    Actor actor = stock_.draw(BodyKind::kPedestrian, own);
    const Eigen::Vector2d here = beside_road(edge, side, s, out).point;
    if (!world_.terrain->covers(here)) return;
    if (stands) {
      if (!may_stand) return;
      actor.T_world_body = world_.terrain->T_world_upright(here, own.uniform(0.0, 2.0 * pi));
    } else {
      std::vector<Eigen::Vector2d> points;
      const double way = 1.8 * (span.end_s - span.begin_s);
      // Up to the end of the pavement, and standing there.
      for (double w = 0.0; w < way + 3.0; w += 1.0) {
        const double at = forward ? s + w : s - w;
        if (at < 1.0 || at > edge.length_m() - 1.0) break;
        points.push_back(beside_road(edge, side, at, out).point);
      }
      if (points.size() < 4) return;
      Motion motion{.path = std::make_shared<Path>(points),
                    .begin_s = span.begin_s,
                    .stations_m = {},
                    .offsets_m = {}};
      for (double t = span.begin_s; t <= span.end_s; t += Motion::kStep_s) {
        motion.stations_m.push_back(
            std::min(speed * (t - span.begin_s), motion.path->length_m() - 0.1));
        motion.offsets_m.push_back(0.0);
      }
      actor.label = label_of(BodyKind::kPedestrian, true);
      actor.motion = std::move(motion);
    }
    world_.actors.push_back(std::move(actor));
  }

  World& world_;
  double vicinity_m_;
  Span whole_;
  BodyStock stock_;
  /// Where we are, each second of all the time.
  std::vector<Eigen::Vector2d> way_;
};

}  // namespace

void add_walkers(World& world, const Plan& plan, const WorldSpec& spec) {
  if (plan.walkers_per_100_m <= 0.0) return;
  Walkers walkers(world, plan, spec);
  for (std::size_t e = 0; e < world.network->edges().size(); ++e) {
    const RoadEdge& edge = world.network->edges()[e];
    for (const int side : {0, 1}) {
      Random random(day_key(spec, Stream::kWalkers, 2 * e + static_cast<std::uint64_t>(side)));
      for (double s = random.uniform(2.0, 30.0); s < edge.length_m() - 2.0;
           s += 100.0 / plan.walkers_per_100_m * random.uniform(0.3, 1.7)) {
        walkers.add(edge, side, s, random.bits());
      }
    }
  }
}

}  // namespace stillmap::simulation
