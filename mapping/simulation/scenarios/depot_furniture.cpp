#include <numbers>

#include "geometry/random.hpp"
#include "scenarios/scenario.hpp"
#include "scenery/buildings.hpp"
#include "scenery/furniture.hpp"
#include "scenery/plants.hpp"

namespace stillmap::simulation {
namespace {

using std::numbers::pi;

class DepotFurnisher {
 public:
  DepotFurnisher(Scenery& scenery, const Plan& plan, const WorldSpec& spec)
      : scenery_(scenery), plan_(plan), spec_(spec) {
    lamps_ = scenery.variants(2, 60, make_lamp);
    bollards_ = scenery.variants(2, 61, make_bollard);
    bins_ = scenery.variants(3, 62, make_bin);
    signs_ = scenery.variants(4, 63, make_traffic_sign);
    containers_ = scenery.variants(6, 64, make_container_stack);
    fences_ = scenery.variants(
        2, 65, [](Random& r) { return make_border_piece(BorderKind::kMeshFence, 4.0, 2.2, r); });
    trees_ = scenery.variants(
        4, 66, [](Random& r) { return make_tree(TreeKind::kLarge, 1.0, Random(r.bits())); });
    sites_ = scenery.variants(2, 67, make_building_site);
  }

  void furnish(std::size_t e) {
    const RoadEdge& edge = plan_.network->edges()[e];
    for (const int side : {0, 1}) {
      Random random(key_of(scenery_.seed(), Stream::kFurniture,
                           100 + 2 * e + static_cast<std::uint64_t>(side)));
      const double begin = plan_.network->node_radius_m(edge.from) + 2.0;
      const double end = edge.length_m() - plan_.network->node_radius_m(edge.to) - 2.0;
      const bool outer = is_outer(edge, side);
      const bool hall = random.chance(outer ? 0.5 : 0.7);
      for (double s = begin; s < end; s += 25.0) put(lamps_, edge, side, s, 0.6, random);
      for (double s = begin + 5.0; s < end; s += random.uniform(20.0, 40.0))
        put(signs_, edge, side, s, 0.7, random, pi);
      for (double s = begin + 2.0; s < end; s += random.uniform(12.0, 30.0))
        put(bins_, edge, side, s, 1.5, random);
      if (hall) {
        add_hall(edge, side, begin, end, outer, random);
      } else {
        stack(edge, side, begin, end, random);
      }
      if (outer) enclose(edge, side, random);
      const bool site = random.chance(0.3);
      const double where = random.uniform(begin, end);
      if (site && spec_.change) put(sites_, edge, side, where, -2.0, random);
    }
  }

 private:
  /// Whether nothing of the depot lies beyond this side: the roads' middle is on the other one.
  [[nodiscard]] bool is_outer(const RoadEdge& edge, int side) const {
    Eigen::Vector2d middle = Eigen::Vector2d::Zero();
    for (const auto& node : plan_.network->nodes()) middle += node.position;
    middle /= static_cast<double>(plan_.network->nodes().size());
    const double s = 0.5 * edge.length_m();
    const double here = (edge.point(s, side == 0 ? 10.0 : -10.0) - middle).norm();
    const double there = (edge.point(s, side == 0 ? -10.0 : 10.0) - middle).norm();
    return here > there && (edge.point(s) - middle).norm() > 25.0;
  }

  void put(const std::vector<std::size_t>& kinds, const RoadEdge& edge, int side, double station,
           double out, Random& random, double turn = 0.0) {
    const std::size_t kind = kinds[random.index(kinds.size())];
    const Eigen::Isometry3d T =
        T_world_roadside(*scenery_.world().terrain, edge, side, station, out);
    scenery_.place(kind, T * Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitZ()));
  }

  void add_hall(const RoadEdge& edge, int side, double begin, double end, bool outer,
                Random& random) {
    const double middle = 0.5 * (begin + end);
    if (!scenery_.world().terrain->covers(edge.point(middle))) return;
    const BuildingShape shape{BuildingKind::kHall, 0.85 * (end - begin), outer ? 24.0 : 14.0, 2};
    Random own(random.bits());
    add_building(scenery_.world().buildings,
                 T_world_roadside(*scenery_.world().terrain, edge, side, middle, 3.0), shape, own);
  }

  void stack(const RoadEdge& edge, int side, double begin, double end, Random& random) {
    const bool along = random.chance(0.5);
    for (double s = begin + 4.0; s < end - 4.0; s += along ? 13.5 : 3.2) {
      if (random.chance(0.8))
        put(containers_, edge, side, s, along ? 4.0 : 8.0, random, along ? 0.0 : 0.5 * pi);
    }
  }

  void enclose(const RoadEdge& edge, int side, Random& random) {
    for (double s = 0.0; s + 4.0 <= edge.length_m(); s += 4.0) {
      put(fences_, edge, side, side == 0 ? s : s + 4.0, 32.0, random);
      if (random.chance(0.25))
        put(trees_, edge, side, s, random.uniform(36.0, 50.0), random,
            random.uniform(0.0, 2.0 * pi));
    }
  }

  Scenery& scenery_;
  const Plan& plan_;
  const WorldSpec& spec_;
  std::vector<std::size_t> lamps_, bollards_, bins_, signs_, containers_, fences_, trees_, sites_;
};

}  // namespace

void furnish_depot(Scenery& scenery, const Plan& plan, const WorldSpec& spec) {
  DepotFurnisher furnisher(scenery, plan, spec);
  for (std::size_t e = 0; e < plan.network->edges().size(); ++e) furnisher.furnish(e);
}

}  // namespace stillmap::simulation
