#include <cmath>
#include <numbers>

#include "geometry/random.hpp"
#include "scenarios/scenario.hpp"
#include "scenery/furniture.hpp"
#include "scenery/plants.hpp"

namespace stillmap::simulation {
namespace {

using std::numbers::pi;

constexpr double kBorderPieceM = 4.0;

class HighwayFurnisher {
 public:
  HighwayFurnisher(Scenery& scenery, const Plan& plan, const WorldSpec& spec)
      : scenery_(scenery), plan_(plan), spec_(spec) {
    Random of_day(day_key(spec, Stream::kPlants, 1));
    const double foliage = of_day.uniform(0.85, 1.0);
    rails_ = scenery.variants(2, 40, [](Random& r) {
      return make_border_piece(BorderKind::kGuardRail, kBorderPieceM, 0.75, r);
    });
    noise_walls_ = scenery.variants(2, 41, [](Random& r) {
      return make_border_piece(BorderKind::kNoiseWall, kBorderPieceM, 3.5, r);
    });
    fences_ = scenery.variants(2, 42, [](Random& r) {
      return make_border_piece(BorderKind::kMeshFence, kBorderPieceM, 1.6, r);
    });
    posts_ = scenery.variants(2, 43, make_bollard);
    signs_ = scenery.variants(5, 44, make_traffic_sign);
    lamps_ = scenery.variants(2, 45, make_lamp);
    trees_ = scenery.variants(6, 46, [foliage](Random& r) {
      return make_tree(r.chance(0.3) ? TreeKind::kConifer : TreeKind::kLarge, foliage,
                       Random(r.bits()));
    });
    bushes_ = scenery.variants(
        6, 47, [foliage](Random& r) { return make_bush(foliage, Random(r.bits())); });
    tufts_ = scenery.variants(
        4, 48, [foliage](Random& r) { return make_tuft(foliage, Random(r.bits())); });
    const RoadSection& section = plan.network->edges().front().section;
    const double width =
        section.lanes * section.lane_width + section.shoulder + 0.5 * section.median;
    gantries_ = scenery.variants(2, 49, [width](Random& r) { return make_gantry(width + 1.5, r); });
  }

  void furnish(std::size_t e) {
    const RoadEdge& edge = plan_.network->edges()[e];
    add_median(edge);
    for (const int side : {0, 1}) {
      Random random(key_of(scenery_.seed(), Stream::kFurniture,
                           100 + 2 * e + static_cast<std::uint64_t>(side)));
      const bool rail = random.chance(0.5);
      const bool wall = random.chance(0.25);
      const bool fence = !wall && random.chance(0.5);
      const bool lit = random.chance(0.2);
      const double site = random.uniform(20.0, edge.length_m() - 40.0);
      const bool work = random.chance(0.3) && spec_.change;
      for (double s = 0.0; s + kBorderPieceM <= edge.length_m(); s += kBorderPieceM) {
        if (rail) piece(rails_, edge, side, s, 0.6, random);
        if (wall) piece(noise_walls_, edge, side, s, 3.0, random);
        if (fence && !(work && std::abs(s - site) < 30.0))
          piece(fences_, edge, side, s, 9.0, random);
      }
      for (double s = 10.0; s < edge.length_m(); s += 50.0) {
        put(posts_, edge, side, s, 0.4, random, 0.0);
        if (lit) put(lamps_, edge, side, s, 1.2, random, 0.0);
      }
      for (double s = random.uniform(0.0, 120.0); s < edge.length_m();
           s += random.uniform(80.0, 250.0))
        put(signs_, edge, side, s, 1.0, random, pi);
      if (random.chance(0.4))
        put(gantries_, edge, side, random.uniform(40.0, 360.0), 0.7, random, 0.0);
      grow(edge, side, wall, random);
    }
  }

 private:
  void put(const std::vector<std::size_t>& kinds, const RoadEdge& edge, int side, double station,
           double out, Random& random, double turn) {
    const std::size_t kind = kinds[random.index(kinds.size())];
    const Eigen::Isometry3d T =
        T_world_roadside(*scenery_.world().terrain, edge, side, station, out);
    scenery_.place(kind, T * Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitZ()),
                   random.uniform(0.9, 1.1));
  }

  /// A straight piece from this station on.
  void piece(const std::vector<std::size_t>& kinds, const RoadEdge& edge, int side, double station,
             double out, Random& random) {
    const std::size_t kind = kinds[random.index(kinds.size())];
    // On the left side of the line the frame's x leads along it, on the right side against it.
    const double from = side == 0 ? station : station + kBorderPieceM;
    scenery_.place(kind, T_world_roadside(*scenery_.world().terrain, edge, side, from, out));
  }

  void add_median(const RoadEdge& edge) {
    Random random(key_of(scenery_.seed(), Stream::kFurniture, 90));
    const double half = edge.half_width(0) - 0.5 * edge.section.median + 0.4;
    for (double s = 0.0; s + kBorderPieceM <= edge.length_m(); s += kBorderPieceM) {
      for (const int side : {0, 1}) piece(rails_, edge, side, s, -half, random);
    }
  }

  void grow(const RoadEdge& edge, int side, bool wall, Random& random) {
    const double first = wall ? 5.0 : 9.5;
    const double trees_per_m = random.chance(0.6) ? random.uniform(0.05, 0.25) : 0.01;
    for (double s = 0.0; s < edge.length_m(); s += 1.0) {
      if (random.chance(trees_per_m))
        put(trees_, edge, side, s, first + random.uniform(1.0, 20.0), random,
            random.uniform(0.0, 2.0 * pi));
      if (random.chance(0.15))
        put(bushes_, edge, side, s, first + random.uniform(0.0, 8.0), random,
            random.uniform(0.0, 2.0 * pi));
      if (random.chance(0.5))
        put(tufts_, edge, side, s, random.uniform(0.8, 9.0), random, random.uniform(0.0, 2.0 * pi));
    }
  }

  Scenery& scenery_;
  const Plan& plan_;
  const WorldSpec& spec_;
  std::vector<std::size_t> rails_, noise_walls_, fences_, posts_, signs_, lamps_, trees_, bushes_,
      tufts_, gantries_;
};

}  // namespace

void furnish_highway(Scenery& scenery, const Plan& plan, const WorldSpec& spec) {
  HighwayFurnisher furnisher(scenery, plan, spec);
  for (std::size_t e = 0; e < plan.network->edges().size(); ++e) furnisher.furnish(e);
}

}  // namespace stillmap::simulation
