#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "geometry/random.hpp"
#include "scenarios/scenario.hpp"

/// The town, the city and the depot: roads on a bent grid.
namespace stillmap::simulation {
namespace {

using std::numbers::pi;

struct Grid {
  std::size_t columns = 3;
  std::size_t rows = 3;
  double spacing_low_m = 100.0;
  double spacing_high_m = 140.0;
  /// How far nodes and headings leave the grid [m, rad].
  double jitter_m = 9.0;
  double turn_rad = 0.16;
  /// Roads that lead out of it [m]; 0 for none.
  double stub_m = 140.0;
};

using SectionMaker = std::function<RoadSection(Random&)>;

class GridBuilder {
 public:
  GridBuilder(const Grid& grid, std::uint64_t seed, SectionMaker make_section)
      : grid_(grid), random_(key_of(seed, Stream::kRoad)), make_section_(std::move(make_section)) {}

  std::shared_ptr<RoadNetwork> build() {
    place_nodes();
    for (std::size_t row = 0; row < grid_.rows; ++row) {
      for (std::size_t column = 0; column < grid_.columns; ++column) {
        if (column + 1 < grid_.columns) connect(node(column, row), node(column + 1, row), 0.0);
        if (row + 1 < grid_.rows) connect(node(column, row), node(column, row + 1), 0.5 * pi);
      }
    }
    if (grid_.stub_m > 0.0) add_stubs();
    network_->finish();
    return std::move(network_);
  }

 private:
  [[nodiscard]] std::size_t node(std::size_t column, std::size_t row) const {
    return row * grid_.columns + column;
  }

  void place_nodes() {
    std::vector<double> x{0.0};
    std::vector<double> y{0.0};
    const auto spacing = [&] { return random_.uniform(grid_.spacing_low_m, grid_.spacing_high_m); };
    while (x.size() < grid_.columns) x.push_back(x.back() + spacing());
    while (y.size() < grid_.rows) y.push_back(y.back() + spacing());
    for (std::size_t row = 0; row < grid_.rows; ++row) {
      for (std::size_t column = 0; column < grid_.columns; ++column) {
        const double dx = random_.uniform(-grid_.jitter_m, grid_.jitter_m);
        const double dy = random_.uniform(-grid_.jitter_m, grid_.jitter_m);
        network_->add_node({x[column] + dx, y[row] + dy});
        turns_.push_back(random_.uniform(-grid_.turn_rad, grid_.turn_rad));
      }
    }
  }

  void connect(std::size_t from, std::size_t to, double axis) {
    network_->add_edge(from, to, {axis + turns_[from], axis + turns_[to]}, make_section_(random_));
  }

  void add_stubs() {
    const auto add = [&](std::size_t at, double axis) {
      const double heading = axis + turns_[at];
      const Eigen::Vector2d out =
          grid_.stub_m * Eigen::Vector2d(std::cos(heading), std::sin(heading));
      const std::size_t end = network_->add_node(network_->nodes()[at].position + out);
      const double bend = random_.uniform(-0.3, 0.3);
      network_->add_edge(at, end, {heading, heading + bend}, make_section_(random_));
    };
    for (std::size_t row = 0; row < grid_.rows; ++row) {
      add(node(0, row), pi);
      add(node(grid_.columns - 1, row), 0.0);
    }
    for (std::size_t column = 0; column < grid_.columns; ++column) {
      add(node(column, 0), -0.5 * pi);
      add(node(column, grid_.rows - 1), 0.5 * pi);
    }
  }

  Grid grid_;
  Random random_;
  SectionMaker make_section_;
  std::shared_ptr<RoadNetwork> network_ = std::make_shared<RoadNetwork>();
  std::vector<double> turns_;
};

/// Twice and in both directions over every road between the first 3 x 2 nodes, never turning round.
std::vector<std::size_t> small_round(const Grid& grid) {
  const std::size_t a = 0, b = 1, c = grid.columns + 1, d = grid.columns, e = 2,
                    f = grid.columns + 2;
  return {a, b, c, d, a, b, e, f, c, b, a, d, c, f, e, b, c, d};
}

/// Over every road, never turning round: along the rows, one after the other, and then along the
/// columns. The grid is square and its number of rows odd, so that the end is next to the start.
std::vector<std::size_t> round_over_all(const Grid& grid) {
  const std::size_t n = grid.rows;
  std::vector<std::size_t> nodes;
  for (std::size_t row = 0; row < n; ++row) {
    for (std::size_t i = 0; i < n; ++i) nodes.push_back(row * n + (row % 2 == 0 ? i : n - 1 - i));
  }
  // The last node of the rows is the first of the columns, and their last one where rows begin.
  for (std::size_t i = 1; i + 1 < n * n; ++i) {
    const std::size_t column = n - 1 - i / n;
    const std::size_t row = i / n % 2 == 0 ? n - 1 - i % n : i % n;
    nodes.push_back(row * n + column);
  }
  return nodes;
}

/// Round and round.
Route own_route(const RoadNetwork& network, const std::vector<std::size_t>& round, double way_m) {
  std::vector<std::size_t> nodes;
  double length = 0.0;
  for (std::size_t i = 0; length < way_m + 300.0; ++i) {
    nodes.push_back(round.at(i % round.size()));
    if (nodes.size() < 2) continue;
    length +=
        (network.nodes()[nodes.back()].position - network.nodes()[nodes[nodes.size() - 2]].position)
            .norm();
  }
  Route route = make_route(network, legs_through(network, nodes), 0);
  // The first crossing comes early, so that short drives have one.
  route.start_m = std::max(route.start_m, route.stops.front().station_m - 45.0);
  return route;
}

RoadSection street_section(Random& random) {
  constexpr std::array<ParkingKind, 9> kKinds{
      ParkingKind::kParallel,       ParkingKind::kParallel,      ParkingKind::kParallel,
      ParkingKind::kHalfOnPavement, ParkingKind::kPerpendicular, ParkingKind::kAngled,
      ParkingKind::kNone,           ParkingKind::kNone,          ParkingKind::kNone};
  RoadSection section;
  section.lane_width = random.uniform(2.8, 3.4);
  for (ParkingKind& kind : section.parking) kind = kKinds.at(random.index(kKinds.size()));
  section.kerb_height = random.uniform(0.04, 0.13);
  section.pavement_width = random.uniform(1.6, 3.6);
  return section;
}

RoadSection yard_section(Random& random) {
  RoadSection section;
  section.lane_width = 3.5;
  section.shoulder = random.uniform(5.0, 8.0);
  section.kerb_height = 0.02;
  section.pavement_width = 0.5;
  return section;
}

/// Streets on a grid, driven along a round.
Plan plan_streets(const WorldSpec& spec, const Grid& grid, const std::vector<std::size_t>& round) {
  Plan plan;
  plan.network = GridBuilder(grid, spec.seed, street_section).build();
  Random random(key_of(spec.seed, Stream::kRoad, 1));
  plan.relief = {.max_grade = random.uniform(0.02, 0.10), .hill_length_m = 260.0, .dip_m = 0.05};
  plan.plots = plan_plots(*plan.network, spec.seed);
  plan.traffic.mix = {
      {BodyKind::kSmallCar, 3}, {BodyKind::kSaloon, 3},         {BodyKind::kEstate, 3},
      {BodyKind::kSuv, 2},      {BodyKind::kVan, 1.5},          {BodyKind::kTruck, 0.5},
      {BodyKind::kBus, 0.4},    {BodyKind::kMotorcyclist, 0.5}, {BodyKind::kCyclist, 2}};
  plan.parked_mix = {{BodyKind::kSmallCar, 4},  {BodyKind::kSaloon, 3},
                     {BodyKind::kEstate, 3},    {BodyKind::kSuv, 2},
                     {BodyKind::kVan, 1.2},     {BodyKind::kTruck, 0.2},
                     {BodyKind::kTrailer, 0.3}, {BodyKind::kMotorcycle, 0.4}};
  plan.parked_share = 0.4;
  plan.own_route = own_route(*plan.network, round, plan.traffic.own_speed_mps * spec.duration_s);
  return plan;
}

}  // namespace

Plan plan_town(const WorldSpec& spec) {
  const Grid grid;
  return plan_streets(spec, grid, small_round(grid));
}

Plan plan_city(const WorldSpec& spec) {
  Grid grid;
  grid.columns = grid.rows = kCityRows;
  Plan plan = plan_streets(spec, grid, round_over_all(grid));
  plan.traffic.vicinity_m = 250.0;
  return plan;
}

Plan plan_depot(const WorldSpec& spec) {
  const Grid grid{.columns = 3,
                  .rows = 2,
                  .spacing_low_m = 70.0,
                  .spacing_high_m = 100.0,
                  .jitter_m = 2.0,
                  .turn_rad = 0.02,
                  .stub_m = 0.0};
  Plan plan;
  plan.network = GridBuilder(grid, spec.seed, yard_section).build();
  plan.relief = {.max_grade = 0.01, .hill_length_m = 200.0, .dip_m = 0.02};
  plan.cover = {.beside = Surface::kGravel, .beside_roughness_m = 0.02, .road_roughness_m = 0.006};
  plan.traffic = {.spacing_m = 110.0,
                  .speed_mps = 4.0,
                  .speed_spread_mps = 1.0,
                  .mix = {},
                  .overtakes = false,
                  .own_speed_mps = 4.0};
  plan.traffic.mix = {{BodyKind::kTruck, 2},
                      {BodyKind::kArticulatedTruck, 2},
                      {BodyKind::kVan, 2},
                      {BodyKind::kEstate, 1}};
  plan.parked_mix = {{BodyKind::kTruck, 2},
                     {BodyKind::kArticulatedTruck, 2},
                     {BodyKind::kVan, 3},
                     {BodyKind::kTrailer, 3},
                     {BodyKind::kSaloon, 1}};
  plan.walkers_per_100_m = 3.0;
  plan.own_route =
      own_route(*plan.network, small_round(grid), plan.traffic.own_speed_mps * spec.duration_s);
  return plan;
}

}  // namespace stillmap::simulation
