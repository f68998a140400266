#include <algorithm>
#include <numbers>

#include "geometry/random.hpp"
#include "scenarios/scenario.hpp"
#include "scenery/furniture.hpp"
#include "scenery/plants.hpp"

namespace stillmap::simulation {
namespace {

using std::numbers::pi;

constexpr double kBuildingSiteShare = 0.25;

/// What stands on pavements, by the kerb or by the houses.
class StreetFurnisher {
 public:
  StreetFurnisher(Scenery& scenery, const Plan& plan, const WorldSpec& spec)
      : scenery_(scenery), plan_(plan), spec_(spec) {
    Random of_day(day_key(spec, Stream::kPlants, 1));
    const double foliage = of_day.uniform(0.85, 1.0);
    lamps_ = scenery.variants(3, 20, make_lamp);
    signs_ = scenery.variants(6, 21, make_traffic_sign);
    lights_ = scenery.variants(2, 22, make_traffic_light);
    bollards_ = scenery.variants(2, 23, make_bollard);
    bins_ = scenery.variants(4, 24, make_bin);
    benches_ = scenery.variants(2, 25, make_bench);
    shelters_ = scenery.variants(2, 26, make_bus_shelter);
    cabinets_ = scenery.variants(3, 27, make_cabinet);
    poles_ = scenery.variants(2, 28, make_utility_pole);
    trees_ = scenery.variants(6, 29, [foliage](Random& r) {
      return make_tree(r.chance(0.25) ? TreeKind::kYoung : TreeKind::kStreet, foliage,
                       Random(r.bits()));
    });
    sites_ = scenery.variants(3, 30, make_building_site);
  }

  void furnish(std::size_t e) {
    const RoadEdge& edge = plan_.network->edges()[e];
    for (const int side : {0, 1}) {
      Random random(key_of(scenery_.seed(), Stream::kFurniture,
                           100 + 2 * e + static_cast<std::uint64_t>(side)));
      begin_ = std::max(3.0, plan_.network->node_radius_m(edge.from) + 1.0);
      end_ = edge.length_m() - std::max(3.0, plan_.network->node_radius_m(edge.to) + 1.0);
      if (end_ - begin_ < 20.0) continue;
      by_the_kerb(edge, side, random);
      by_the_houses(edge, side, random);
      at_the_crossing(edge, side, random);
      // Drawn last and on every day, so that nothing else hangs on it.
      const bool site = random.chance(kBuildingSiteShare);
      const double where = random.uniform(begin_ + 8.0, end_ - 8.0);
      if (site && spec_.change) put(sites_, edge, side, where, 1.0, random);
    }
  }

 private:
  void put(const std::vector<std::size_t>& kinds, const RoadEdge& edge, int side, double station,
           double out, Random& random, double turn = 0.0) {
    const std::size_t kind = kinds[random.index(kinds.size())];
    if (edge.has_drive(side, station)) return;
    const Eigen::Isometry3d T =
        T_world_roadside(*scenery_.world().terrain, edge, side, station, out);
    scenery_.place(kind, T * Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitZ()));
  }

  void by_the_kerb(const RoadEdge& edge, int side, Random& random) {
    const bool lamps_here = random.chance(0.6);
    const bool trees_here = random.chance(0.65) && edge.section.pavement_width > 2.0;
    const bool bollards_here = random.chance(0.15);
    const double lamp_phase = random.uniform(0.0, 28.0);
    const double tree_every = random.uniform(7.0, 13.0);
    const double by_kerb =
        edge.section.parking[static_cast<std::size_t>(side)] == ParkingKind::kHalfOnPavement ? 1.5
                                                                                             : 0.45;
    const double out = std::min(by_kerb, edge.section.pavement_width - 0.3);
    for (double s = begin_ + lamp_phase; lamps_here && s < end_; s += 28.0)
      put(lamps_, edge, side, s, out, random);
    for (double s = begin_ + 6.0; trees_here && s < end_; s += tree_every) {
      if (random.chance(0.85))
        put(trees_, edge, side, s, out + 0.15, random, random.uniform(0.0, 2.0 * pi));
    }
    for (double s = begin_ + 1.0; bollards_here && s < end_; s += 1.8)
      put(bollards_, edge, side, s, 0.3, random);
    for (double s = begin_ + 2.0; s < end_; s += random.uniform(14.0, 40.0))
      put(signs_, edge, side, s, out, random, pi);
  }

  void by_the_houses(const RoadEdge& edge, int side, Random& random) {
    const double out = edge.section.pavement_width;
    for (double s = begin_ + random.uniform(2.0, 20.0); s < end_; s += random.uniform(10.0, 35.0)) {
      const double u = random.uniform();
      if (u < 0.4) {
        const auto count = 1 + random.index(4);
        for (std::size_t i = 0; i < count; ++i)
          put(bins_, edge, side, s + 0.7 * static_cast<double>(i), out - 0.4, random);
      } else if (u < 0.65) {
        put(cabinets_, edge, side, s, out - 0.3, random);
      } else if (u < 0.8) {
        put(benches_, edge, side, s, out - 0.5, random);
      } else if (u < 0.9) {
        put(poles_, edge, side, s, out + 0.2, random);
      }
    }
    if (random.chance(0.3))
      put(shelters_, edge, side, random.uniform(begin_ + 5.0, end_ - 5.0), out - 1.6, random);
  }

  void at_the_crossing(const RoadEdge& edge, int side, Random& random) {
    // Right-hand traffic reaches the edge's end on its right side, and its start on the left.
    const std::size_t node = side == 1 ? edge.to : edge.from;
    if (plan_.network->nodes()[node].edges.size() < 3) return;
    put(lights_, edge, side, side == 1 ? end_ : begin_, 0.5, random, pi);
  }

  Scenery& scenery_;
  const Plan& plan_;
  const WorldSpec& spec_;
  double begin_ = 0.0;
  double end_ = 0.0;
  std::vector<std::size_t> lamps_, signs_, lights_, bollards_, bins_, benches_, shelters_,
      cabinets_, poles_, trees_, sites_;
};

}  // namespace

void furnish_streets(Scenery& scenery, const Plan& plan, const WorldSpec& spec) {
  StreetFurnisher furnisher(scenery, plan, spec);
  for (std::size_t e = 0; e < plan.network->edges().size(); ++e) furnisher.furnish(e);
}

}  // namespace stillmap::simulation
