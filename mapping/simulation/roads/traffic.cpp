#include "roads/traffic.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <optional>

#include "geometry/random.hpp"
#include "roads/traffic_vehicle.hpp"

namespace stillmap::simulation {
namespace {

constexpr double kTrafficStepS = Motion::kStep_s;
// Traffic settles before the drive begins.
constexpr double kSettle_s = 12.0;
constexpr double kMargin_s = 1.0;
constexpr double kNever = std::numeric_limits<double>::max();
constexpr double kSwerve_mps = 0.9;
// How far beside one's path another vehicle no longer is in the way [m].
constexpr double kLane = 1.5;
constexpr double kSwerve = 1.2;
// Our own place at the start stays free [m].
constexpr double kOwnRoom = 25.0;
// Cosine of the angle within which two vehicles drive the same way.
constexpr double kSameWay = 0.6;
constexpr double kCyclistOffset = -1.1;
// Each approach of a crossing has this long, of which it may drive in the first part.
constexpr double kPhase_s = 8.0;
constexpr double kGreen_s = 6.0;
// We announce ourselves at crossings, and let the others wait.
constexpr double kOwnNotice = 45.0;
constexpr double kOwnWait_s = 3.0;
constexpr double kOwnWaits = 0.3;
// Traffic in our vicinity only: vehicles leave this far beyond it [m], we look for those that come
// and go every so many steps, and a vehicle's route is this long [m].
constexpr double kVicinityMargin = 50.0;
constexpr int kVicinitySteps = 10;
constexpr double kVicinityWay = 2500.0;

class Traffic {
 public:
  Traffic(const RoadNetwork& network, const TrafficSpec& spec, const TrafficRun& run)
      : network_(network),
        spec_(spec),
        duration_s_(run.duration_s),
        key_(run.key),
        cancel_(run.cancel) {}

  std::vector<Driven> run(const Route& own) {
    add_own(own);
    if (near_us_only()) {
      for_each_lane([&](const Leg& leg, int lane) {
        std::ranges::move(places_in(leg, lane), std::back_inserter(places_));
      });
      time_ = -kSettle_s;
      follow_us(own.path->point(own.start_m));
    } else {
      populate(own);
    }
    const auto steps =
        static_cast<int>(std::ceil((kSettle_s + duration_s_ + kMargin_s) / kTrafficStepS));
    for (int i = 0; i <= steps; ++i) {
      if (cancel_ != nullptr && cancel_->load()) throw mapping::Cancelled();
      time_ = kTrafficStepS * i - kSettle_s;
      if (near_us_only() && i > 0 && i % kVicinitySteps == 0) {
        const Vehicle& us = vehicles_.front();
        follow_us(us.route.path->point(us.station));
      }
      step(i);
    }
    std::vector<Driven> driven;
    for (Vehicle& v : vehicles_) finish(driven, v);
    std::move(finished_.begin(), finished_.end(), std::back_inserter(driven));
    return driven;
  }

 private:
  static void finish(std::vector<Driven>& driven, Vehicle& v) {
    if (v.motion.stations_m.size() < 4) return;
    v.motion.path = v.route.path;
    driven.push_back({v.kind, v.key, std::move(v.motion)});
  }

  [[nodiscard]] bool near_us_only() const { return spec_.vicinity_m > 0.0; }

  void add_own(const Route& own) {
    Vehicle v;
    v.kind = BodyKind::kEstate;
    v.route = own;
    v.own = true;
    v.wish_mps = spec_.own_speed_mps;
    v.allowed = allowed_speeds(*own.path);
    v.enters_s = -kMargin_s;
    v.station = own.start_m;
    v.speed = std::min(spec_.own_speed_mps, v.allowed.at(static_cast<std::size_t>(own.start_m)));
    skip_passed_stops(v);
    v.present = false;
    vehicles_.push_back(std::move(v));
  }

  BodyKind draw_kind(Random& random) const {
    double sum = 0.0;
    for (const auto& [kind, share] : spec_.mix) sum += share;
    double at = random.uniform() * sum;
    for (const auto& [kind, share] : spec_.mix) {
      at -= share;
      if (at < 0.0) return kind;
    }
    return spec_.mix.front().first;
  }

  /// Some legs on from a first one, turning by chance, never back.
  std::vector<Leg> wander(const Leg& first, double length, Random random) const {
    std::vector<Leg> legs{first};
    double covered = 0.0;
    while (covered < length) {
      const RoadEdge& edge = network_.edges()[legs.back().edge];
      covered += edge.length_m();
      const std::size_t node = legs.back().forward ? edge.to : edge.from;
      std::vector<std::size_t> ways;
      for (const std::size_t e : network_.nodes()[node].edges) {
        if (e != legs.back().edge) ways.push_back(e);
      }
      if (ways.empty()) break;
      const std::size_t e = ways[random.index(ways.size())];
      legs.push_back({e, network_.edges()[e].from == node});
    }
    return legs;
  }

  /// Where and when a vehicle starts; everything else about it follows from the key.
  struct Start {
    Leg leg;
    int lane = 0;
    double station = 0.0;
    double time_s = -kSettle_s;
    std::uint64_t key = 0;
  };

  void add(const Start& start) {
    Random random(start.key);
    Vehicle v;
    v.key = random.bits();
    v.kind = draw_kind(random);
    v.wish_mps = v.cycles() ? random.uniform(3.5, 6.0)
                            : spec_.speed_mps + spec_.speed_spread_mps * random.uniform(-1.0, 1.0);
    const double truck_mps = random.uniform(22.0, 24.5);
    if (spec_.overtakes && length_of(v.kind) > 9.0) v.wish_mps = std::min(v.wish_mps, truck_mps);
    v.home_offset = v.cycles() ? kCyclistOffset : random.uniform(-0.25, 0.25);
    double way = (duration_s_ + kSettle_s + kMargin_s) * v.wish_mps + start.station + 60.0;
    if (near_us_only()) way = std::min(way, kVicinityWay);
    v.route = make_route(network_, wander(start.leg, way, random), start.lane);
    if (start.station > v.route.path->length_m() - 5.0) return;
    v.offset = v.wanted_offset = v.home_offset;
    v.allowed = allowed_speeds(*v.route.path);
    v.station = start.station;
    v.speed = std::min(0.8 * v.wish_mps, v.allowed[static_cast<std::size_t>(start.station)]);
    v.enters_s = start.time_s;
    v.can_pass = spec_.overtakes && start.lane > 0;
    v.present = start.time_s <= -kSettle_s;
    if (v.present) v.enters_s = kNever;
    skip_passed_stops(v);
    vehicles_.push_back(std::move(v));
  }

  static void skip_passed_stops(Vehicle& v) {
    while (v.next_stop < v.route.stops.size() &&
           v.route.stops[v.next_stop].station_m < v.station - 0.5) {
      ++v.next_stop;
    }
  }

  /// Where a vehicle of a lane starts, and in our vicinity another one each time that we come near.
  struct Place {
    Start start;
    Eigen::Vector2d at;
    bool near = false;
    std::uint64_t times = 0;
  };

  [[nodiscard]] std::uint64_t key_of_lane(const Leg& leg, int lane) const {
    return key_of({key_, leg.edge, leg.forward ? 1U : 0U, static_cast<std::uint64_t>(lane)});
  }

  [[nodiscard]] std::vector<Place> places_in(const Leg& leg, int lane) const {
    std::vector<Place> places;
    const RoadEdge& edge = network_.edges()[leg.edge];
    Random along(key_of({key_of_lane(leg, lane), 1}));
    for (double s = along.uniform(5.0, spec_.spacing_m); s < edge.length_m() - 15.0;
         s += spec_.spacing_m * along.uniform(0.4, 1.6)) {
      const double station = leg.forward ? s : edge.length_m() - s;
      places.push_back({.start = {.leg = leg, .lane = lane, .station = s, .key = along.bits()},
                        .at = edge.point(station)});
    }
    return places;
  }

  template <typename Visit>
  void for_each_lane(const Visit& visit) const {
    for (std::size_t e = 0; e < network_.edges().size(); ++e) {
      for (const bool forward : {true, false}) {
        for (int lane = 0; lane < network_.edges()[e].section.lanes; ++lane) {
          visit(Leg{e, forward}, lane);
        }
      }
    }
  }

  /// Vehicles all over the lanes, and more that come in where roads end. How long the drive lasts
  /// decides how many come in, and changes nothing about the others.
  void populate(const Route& own) {
    const Eigen::Vector2d start = own.path->point(own.start_m);
    for_each_lane([&](const Leg& leg, int lane) { fill_lane(leg, lane, start); });
  }

  void fill_lane(const Leg& leg, int lane, const Eigen::Vector2d& own_start) {
    for (const Place& place : places_in(leg, lane)) {
      if ((place.at - own_start).norm() > kOwnRoom) add(place.start);
    }
    const RoadEdge& edge = network_.edges()[leg.edge];
    const std::size_t entry = leg.forward ? edge.from : edge.to;
    if (network_.nodes()[entry].edges.size() > 1) return;
    Random later(key_of({key_of_lane(leg, lane), 2}));
    const double every = spec_.spacing_m / spec_.speed_mps;
    for (double t = every - kSettle_s; t < duration_s_; t += every * later.uniform(0.5, 1.5)) {
      add({.leg = leg, .lane = lane, .station = 1.0, .time_s = t, .key = later.bits()});
    }
  }

  /// Lets vehicles start where our vicinity begins, and takes away those that have left it.
  void follow_us(const Eigen::Vector2d& us) {
    std::erase_if(vehicles_, [&](Vehicle& v) {
      if (v.own) return false;
      const bool left = v.present && (v.at - us).norm() > spec_.vicinity_m + kVicinityMargin;
      if (!left && (v.present || v.enters_s != kNever)) return false;
      finish(finished_, v);
      return true;
    });
    for (Place& place : places_) {
      const double away = (place.at - us).norm();
      const bool near = away < spec_.vicinity_m;
      if (near && !place.near && away > kOwnRoom) {
        Start start = place.start;
        start.time_s = time_;
        start.key = key_of({place.start.key, place.times++});
        add(start);
      }
      place.near = near;
    }
  }

  /// What others see of a vehicle; a list of its own, since everyone looks at everyone.
  struct Seen {
    Eigen::Vector2d at;
    Eigen::Vector2d forward;
    double speed = 0.0;
    double half_length = 0.0;
    bool cycles = false;
    const Vehicle* vehicle = nullptr;
  };

  /// Whoever finds no room where it would come in stays away; but for us there is room.
  void enter(Vehicle& v) {
    constexpr double kRoom = 12.0;
    const Eigen::Vector2d at = v.route.path->point(v.station, v.offset);
    bool room = true;
    for (Vehicle& other : vehicles_) {
      if (!other.present || (other.at - at).norm() > kRoom) continue;
      if (v.own) {
        other.present = false;
      } else {
        room = false;
      }
    }
    v.present = room;
    v.enters_s = kNever;
  }

  void step(int number) {
    for (Vehicle& v : vehicles_) {
      if (!v.present && v.enters_s <= time_) enter(v);
    }
    seen_.clear();
    for (Vehicle& v : vehicles_) {
      if (!v.present) continue;
      v.at = v.route.path->point(v.station, v.offset);
      v.heading = v.route.path->heading_rad(v.station);
      seen_.push_back({v.at,
                       {std::cos(v.heading), std::sin(v.heading)},
                       v.speed,
                       0.5 * length_of(v.kind),
                       v.cycles(),
                       &v});
    }
    std::vector<double> speeds;
    speeds.reserve(vehicles_.size());
    for (std::size_t i = 0; i < vehicles_.size(); ++i) {
      Vehicle& v = vehicles_[i];
      // Where to drive is thought over a few times a second, each at its own time.
      constexpr int kThinkEvery = 4;
      if (v.present && (number + static_cast<int>(i)) % kThinkEvery == 0) steer(v);
      speeds.push_back(v.present ? std::max(0.0, v.speed + kTrafficStepS * acceleration(v))
                                 : v.speed);
    }
    for (std::size_t i = 0; i < vehicles_.size(); ++i) move(vehicles_[i], speeds[i]);
  }

  void move(Vehicle& v, double speed) {
    if (!v.present) return;
    if (time_ >= -kMargin_s - 1e-9) {
      if (v.motion.stations_m.empty()) v.motion.begin_s = time_;
      v.motion.stations_m.push_back(v.station);
      v.motion.offsets_m.push_back(v.offset);
    }
    v.station += 0.5 * kTrafficStepS * (v.speed + speed);
    v.waited_s = speed < 0.1 ? v.waited_s + kTrafficStepS : 0.0;
    if (v.waited_s > kOwnWait_s) v.released_stop = v.next_stop + 1;
    v.speed = speed;
    const double change = std::clamp(v.wanted_offset - v.offset, -kSwerve_mps * kTrafficStepS,
                                     kSwerve_mps * kTrafficStepS);
    v.offset += change * std::min(1.0, speed / 2.0);
    skip_passed_stops(v);
    if (v.station > v.route.path->length_m() - 4.0) v.present = false;
  }

  /// Nearest vehicle on the way of `v`, were it `offset` beside its path: gap and speed.
  struct Ahead {
    double gap = 1e9;
    double speed = 0.0;
    bool cycles = false;
  };
  Ahead ahead_of(const Vehicle& v, double offset, double behind) const {
    Ahead ahead;
    const Eigen::Vector2d forward(std::cos(v.heading), std::sin(v.heading));
    const double sight = v.sight_m();
    const double half_length = 0.5 * length_of(v.kind);
    for (const Seen& other : seen_) {
      const Eigen::Vector2d to = other.at - v.at;
      if (to.squaredNorm() > sight * sight || to.dot(forward) < -behind - 5.0) continue;
      // What crosses our way has its own turn; were it waited for, two could wait for each other.
      if (other.forward.dot(forward) < kSameWay || other.vehicle == &v) continue;
      const std::optional<double> way = way_to(v, other.at, offset, behind);
      if (!way || (behind == 0.0 && *way <= 0.0)) continue;
      // Side by side where lanes meet: the first one goes first.
      if (*way < 2.0 && other.vehicle > &v) continue;
      const double gap = *way - half_length - other.half_length;
      if (gap < ahead.gap) {
        ahead = {gap, other.speed * other.forward.dot(forward), other.cycles};
      }
    }
    return ahead;
  }

  /// How far along its path `v` meets a place, if it does.
  static std::optional<double> way_to(const Vehicle& v, const Eigen::Vector2d& other, double offset,
                                      double behind) {
    constexpr double kStride = 2.0;
    const Path& path = *v.route.path;
    for (double s = std::max(1.0, v.station - behind); s < v.station + v.sight_m();) {
      const Eigen::Vector2d local = other - path.point(s);
      const double away = local.norm();
      // The path comes nearer by no more than its own length.
      const double reach = kLane + std::abs(offset) + kStride;
      if (away > reach) {
        s += std::max(kStride, away - reach);
        continue;
      }
      const double heading = path.heading_rad(s);
      const double x = std::cos(heading) * local.x() + std::sin(heading) * local.y();
      const double y = -std::sin(heading) * local.x() + std::cos(heading) * local.y() - offset;
      if (std::abs(x) <= 0.5 * kStride && std::abs(y) <= kLane) return s + x - v.station;
      s += kStride;
    }
    return std::nullopt;
  }

  void steer(Vehicle& v) {
    if (v.cycles()) return;
    v.wanted_offset = v.home_offset;
    const Ahead ahead = ahead_of(v, v.home_offset, 4.0);
    if (ahead.gap < 25.0 && ahead.cycles) v.wanted_offset = v.home_offset + kSwerve;
    if (!spec_.overtakes || !v.can_pass) return;
    // Passes on the left what is slower; one lane only, and back when there is room.
    const double width = network_.edges().front().section.lane_width;
    const bool slower = ahead.gap < 45.0 && ahead.speed < v.wish_mps - 1.5;
    const bool passing = v.offset > v.home_offset + 0.5 * width;
    if (!slower && !(passing && ahead_of(v, v.home_offset, 15.0).gap < 20.0)) return;
    if (passing || ahead_of(v, v.home_offset + width, 30.0).gap > 30.0)
      v.wanted_offset = v.home_offset + width;
  }

  double acceleration(const Vehicle& v) const {
    double braking = 0.0;
    if (const Ahead ahead = ahead_of(v, v.offset, 0.0); ahead.gap < v.sight_m()) {
      braking = std::min(braking, following(v, ahead.gap, ahead.speed));
    }
    if (const auto gap = red_light(v)) braking = std::min(braking, following(v, *gap, 0.0));
    return std::clamp(on_free_road(v) + braking, -5.0, kMostAcceleration);
  }

  /// Way to the line where `v` has to stop, if it has to.
  std::optional<double> red_light(const Vehicle& v) const {
    if (v.next_stop >= v.route.stops.size()) return std::nullopt;
    const StopLine& stop = v.route.stops[v.next_stop];
    const double gap = stop.station_m - v.station - 0.5 * length_of(v.kind);
    // Too late to stop, or too far to care.
    if (gap < v.speed * v.speed / (2.0 * 3.5) - 1.0 || gap > v.sight_m()) return std::nullopt;
    return may_drive(v, stop) ? std::nullopt : std::optional(std::max(gap + kStandGap - 0.5, 0.3));
  }

  bool may_drive(const Vehicle& v, const StopLine& stop) const {
    if (v.own) {
      // Now and then we have to wait ourselves.
      Random random(key_of({key_, stop.node, v.next_stop}));
      return !random.chance(kOwnWaits) || v.released_stop == v.next_stop + 1;
    }
    const Vehicle& own = vehicles_.front();
    if (own.present && own.next_stop < own.route.stops.size()) {
      const StopLine& ours = own.route.stops[own.next_stop];
      if (ours.node == stop.node && ours.station_m - own.station < kOwnNotice)
        return stop.edge == ours.edge;
    }
    const auto& edges = network_.nodes()[stop.node].edges;
    const auto turn =
        static_cast<std::size_t>(std::find(edges.begin(), edges.end(), stop.edge) - edges.begin());
    const double cycle = kPhase_s * static_cast<double>(edges.size());
    const double at =
        std::fmod(time_ + 100.0 * cycle + 3.7 * static_cast<double>(stop.node), cycle);
    const double in_turn = at - kPhase_s * static_cast<double>(turn);
    return in_turn >= 0.0 && in_turn < kGreen_s;
  }

  const RoadNetwork& network_;
  TrafficSpec spec_;
  double duration_s_;
  std::uint64_t key_;
  double time_ = 0.0;
  const mapping::CancelFlag* cancel_;
  std::vector<Vehicle> vehicles_;
  std::vector<Seen> seen_;
  std::vector<Place> places_;
  std::vector<Driven> finished_;
};

}  // namespace

std::vector<Driven> drive_traffic(const RoadNetwork& network, const Route& own,
                                  const TrafficSpec& spec, const TrafficRun& run) {
  return Traffic(network, spec, run).run(own);
}

}  // namespace stillmap::simulation
