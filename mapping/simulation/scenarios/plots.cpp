#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "geometry/random.hpp"
#include "scenarios/scenario.hpp"
#include "scenery/furniture.hpp"
#include "scenery/plants.hpp"

namespace stillmap::simulation {
namespace {

using std::numbers::pi;

/// What kind of quarter one side of a street belongs to.
enum class Quarter { kFlats, kShops, kHouses, kPark };

Quarter draw_quarter(Random& random) {
  const double u = random.uniform();
  if (u < 0.22) return Quarter::kFlats;
  if (u < 0.32) return Quarter::kShops;
  return u < 0.78 ? Quarter::kHouses : Quarter::kPark;
}

Plot building_plot(Quarter quarter, Random& random) {
  Plot plot;
  BuildingShape& b = plot.building;
  if (quarter == Quarter::kHouses) {
    b = {BuildingKind::kHouse, random.uniform(8.0, 13.0), random.uniform(8.0, 11.0),
         1 + static_cast<int>(random.index(2))};
    plot.set_back_m = random.uniform(2.5, 8.0);
  } else {
    const bool shop = quarter == Quarter::kShops && random.chance(0.7);
    b = {shop ? BuildingKind::kShop : BuildingKind::kFlats, random.uniform(9.0, 22.0),
         random.uniform(9.0, 13.0), 3 + static_cast<int>(random.index(4))};
    plot.set_back_m = shop || random.chance(0.6) ? 0.05 : random.uniform(1.5, 4.0);
  }
  return plot;
}

void fill_side(std::vector<Plot>& plots, RoadNetwork& network, std::size_t e, int side,
               std::uint64_t key) {
  RoadEdge& edge = network.edges()[e];
  Random random(key);
  const Quarter quarter = draw_quarter(random);
  const auto setting_off = [&](std::size_t node) {
    return std::max(4.0, network.node_radius_m(node) + 3.0);
  };
  const double end = edge.length_m() - setting_off(edge.to);
  double s = setting_off(edge.from);
  while (s < end - 5.0) {
    Plot plot = building_plot(quarter, random);
    const bool gap = quarter == Quarter::kPark || random.chance(0.12);
    const double width = gap ? random.uniform(6.0, 14.0) : plot.building.width;
    const double room = quarter == Quarter::kHouses
                            ? random.uniform(2.5, 7.0)
                            : (random.chance(0.35) ? random.uniform(2.0, 5.0) : 0.02);
    plot.edge = e;
    plot.side = side;
    plot.begin_m = s;
    plot.end_m = std::min(end, s + width + room);
    plot.kind = quarter == Quarter::kPark ? Plot::Kind::kPark
                : gap                     ? Plot::Kind::kGap
                                          : Plot::Kind::kBuilding;
    plot.key = random.bits();
    const bool has_drive = plot.kind == Plot::Kind::kBuilding && room > 2.4 && random.chance(0.6);
    // Drives lie beside the building, in the room that is left to the next.
    if (has_drive) plot.drive_m = s + width + 0.5 * room;
    if (s + width > end) return;
    if (plot.drive_m)
      edge.drives.at(static_cast<std::size_t>(side))
          .push_back({*plot.drive_m - 1.6, *plot.drive_m + 1.6});
    plots.push_back(plot);
    s += width + room;
  }
}

struct Shapes {
  std::vector<std::size_t> trees;
  std::vector<std::size_t> big_trees;
  std::vector<std::size_t> bushes;
  std::vector<std::size_t> tufts;
};

class PlotBuilder {
 public:
  PlotBuilder(Scenery& scenery, const Plan& plan, const WorldSpec& spec)
      : scenery_(scenery), plan_(plan), spec_(spec) {
    // Some leaves come and go from one day to the next.
    Random of_day(day_key(spec, Stream::kPlants));
    const double foliage = of_day.uniform(0.85, 1.0);
    const auto tree = [foliage](TreeKind kind) {
      return [kind, foliage](Random& r) { return make_tree(kind, foliage, Random(r.bits())); };
    };
    shapes_.trees = scenery.variants(3, 1, tree(TreeKind::kSlim));
    const auto conifers = scenery.variants(3, 2, tree(TreeKind::kConifer));
    shapes_.trees.insert(shapes_.trees.end(), conifers.begin(), conifers.end());
    shapes_.big_trees = scenery.variants(4, 3, tree(TreeKind::kLarge));
    shapes_.bushes = scenery.variants(
        6, 4, [foliage](Random& r) { return make_bush(foliage, Random(r.bits())); });
    shapes_.tufts = scenery.variants(
        5, 5, [foliage](Random& r) { return make_tuft(foliage, Random(r.bits())); });
  }

  void build(const Plot& plot) {
    const RoadEdge& edge = plan_.network->edges()[plot.edge];
    const Eigen::Vector2d middle = at(plot, plot.middle_m(), 6.0).point;
    if (!scenery_.world().terrain->covers(middle)) return;
    Random random(plot.key);
    if (plot.kind == Plot::Kind::kBuilding) {
      const double front = edge.section.pavement_width + plot.set_back_m;
      Random own(random.bits());
      const double station = plot.begin_m + 0.5 * plot.building.width;
      add_building(scenery_.world().buildings, frame(plot, station, front), plot.building, own);
    }
    if (plot.set_back_m > 1.4 || plot.kind != Plot::Kind::kBuilding) {
      add_border(plot, random);
      plant(plot, random);
    }
    if (random.chance(0.45)) add_back_building(plot, random);
    // What grows behind shows between buildings.
    for (int tree = 0; tree < 4; ++tree) {
      if (random.chance(0.7))
        place(shapes_.big_trees, plot, random.uniform(plot.begin_m, plot.end_m) + 2.0,
              random.uniform(15.0, 36.0), random);
    }
  }

 private:
  [[nodiscard]] RoadsideFrame at(const Plot& plot, double station, double beyond) const {
    const RoadEdge& edge = plan_.network->edges()[plot.edge];
    return beside_road(edge, plot.side, station, beyond);
  }
  [[nodiscard]] Eigen::Isometry3d frame(const Plot& plot, double station, double out) const {
    return T_world_roadside(*scenery_.world().terrain, plan_.network->edges()[plot.edge], plot.side,
                            station, out);
  }

  /// Seen over gardens and between the houses of the first row.
  void add_back_building(const Plot& plot, Random& random) {
    BuildingShape shape{BuildingKind::kFlats, random.uniform(10.0, 20.0), 10.0,
                        3 + static_cast<int>(random.index(4))};
    const double out = random.uniform(26.0, 42.0);
    Random own(random.bits());
    const RoadsideFrame there = at(plot, plot.middle_m(), out);
    if (!scenery_.world().terrain->covers(there.point)) return;
    // Not where another street runs.
    const auto place = plan_.network->place(there.point);
    if (!place || place->outside_m < 14.0) return;
    add_building(scenery_.world().buildings, frame(plot, plot.middle_m(), out), shape, own);
  }

  void add_border(const Plot& plot, Random& random) {
    constexpr std::array<BorderKind, 6> kKinds{BorderKind::kWall,    BorderKind::kHedge,
                                               BorderKind::kHedge,   BorderKind::kPicketFence,
                                               BorderKind::kRailing, BorderKind::kMeshFence};
    constexpr double kPiece = 2.0;
    const BorderKind kind = kKinds.at(random.index(kKinds.size()));
    const double height =
        kind == BorderKind::kHedge ? random.uniform(0.8, 2.0) : random.uniform(0.7, 1.6);
    const bool none = random.chance(0.15);
    const bool removed = random.chance(0.15) && spec_.change;
    if (none || removed) return;
    const double out = plan_.network->edges()[plot.edge].section.pavement_width + 0.35;
    const double gate = plot.begin_m + 0.3 * (plot.end_m - plot.begin_m);
    for (double s = plot.begin_m + 0.3; s + kPiece < plot.end_m; s += kPiece) {
      Random own(random.bits());
      const double middle = s + 0.5 * kPiece;
      if (std::abs(middle - gate) < 0.9) continue;
      if (plot.drive_m && std::abs(middle - *plot.drive_m) < 2.4) continue;
      const Mesh piece = make_border_piece(kind, kPiece, height, own);
      // From corner to corner, so that pieces follow the street.
      const Eigen::Isometry3d a = frame(plot, s, out);
      const Eigen::Isometry3d b = frame(plot, s + kPiece, out);
      const bool swapped = (a.inverse() * b.translation()).x() < 0.0;
      const Eigen::Vector3d from = swapped ? b.translation() : a.translation();
      const Eigen::Vector3d to = swapped ? a.translation() : b.translation();
      Eigen::Isometry3d T = a;
      T.linear() = Eigen::AngleAxisd(std::atan2(to.y() - from.y(), to.x() - from.x()),
                                     Eigen::Vector3d::UnitZ())
                       .toRotationMatrix();
      T.translation() = from;
      T.translation().z() = std::min(from.z(), to.z());
      scenery_.world().buildings.add(piece, T);
    }
  }

  void place(const std::vector<std::size_t>& kinds, const Plot& plot, double station, double out,
             Random& random) {
    const std::size_t kind = kinds[random.index(kinds.size())];
    const double turn = random.uniform(0.0, 2.0 * pi);
    const double scale = random.uniform(0.8, 1.2);
    scenery_.place(
        kind, frame(plot, station, out) * Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitZ()), scale);
  }

  void plant(const Plot& plot, Random& random) {
    const double pavement = plan_.network->edges()[plot.edge].section.pavement_width;
    const bool open = plot.kind != Plot::Kind::kBuilding;
    const double depth = open ? 16.0 : plot.set_back_m - 0.6;
    const double area = depth * (plot.end_m - plot.begin_m);
    const auto scatter = [&](const std::vector<std::size_t>& kinds, double per_m2, double margin) {
      const auto count = static_cast<int>(per_m2 * area + random.uniform());
      for (int i = 0; i < count; ++i) {
        const double s = random.uniform(plot.begin_m + 0.5, plot.end_m - 0.5);
        const double out = pavement + margin + random.uniform() * std::max(0.1, depth - margin);
        if (plot.drive_m && std::abs(s - *plot.drive_m) < 1.9) continue;
        place(kinds, plot, s, out, random);
      }
    };
    scatter(shapes_.bushes, 0.09, 0.9);
    scatter(shapes_.tufts, 0.12, 0.4);
    scatter(shapes_.trees, open ? 0.016 : 0.014, 1.5);
    scatter(shapes_.big_trees, open ? 0.014 : 0.005, 2.5);
  }

  Scenery& scenery_;
  const Plan& plan_;
  const WorldSpec& spec_;
  Shapes shapes_;
};

}  // namespace

std::vector<Plot> plan_plots(RoadNetwork& network, std::uint64_t seed) {
  std::vector<Plot> plots;
  for (std::size_t e = 0; e < network.edges().size(); ++e) {
    for (const int side : {0, 1}) {
      fill_side(plots, network, e, side,
                key_of(seed, Stream::kBuildings, 2 * e + static_cast<std::uint64_t>(side)));
    }
  }
  return plots;
}

void build_plots(Scenery& scenery, const Plan& plan, const WorldSpec& spec) {
  PlotBuilder builder(scenery, plan, spec);
  for (const Plot& plot : plan.plots) builder.build(plot);
}

}  // namespace stillmap::simulation
