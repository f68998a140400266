#pragma once

#include <functional>
#include <map>

#include "roads/ground_mesh.hpp"
#include "roads/route.hpp"
#include "roads/traffic.hpp"
#include "scenarios/world.hpp"
#include "scenery/buildings.hpp"

/// Parts that a world is put together from. All of them add to what they are given, and leave out
/// what lies beyond the terrain.
namespace stillmap::simulation {

/// Strip of land along one side of a road.
struct Plot {
  enum class Kind { kBuilding, kGarden, kGap, kPark };
  std::size_t edge = 0;
  /// 0 left, 1 right of the middle line.
  int side = 0;
  double begin_m = 0.0;
  double end_m = 0.0;
  Kind kind = Kind::kBuilding;
  BuildingShape building;
  /// From the pavement to the front [m].
  double set_back_m = 0.0;
  /// Middle of a drive from the road, if there is one.
  std::optional<double> drive_m;
  std::uint64_t key = 0;

  [[nodiscard]] double middle_m() const { return 0.5 * (begin_m + end_m); }
};

/// A scenario before anything is built.
struct Plan {
  std::shared_ptr<RoadNetwork> network;
  Relief relief;
  GroundCover cover;
  std::vector<Plot> plots;
  Route own_route;
  TrafficSpec traffic;
  /// Share of parking places that are taken, and of what.
  double parked_share = 0.65;
  std::vector<std::pair<BodyKind, double>> parked_mix;
  /// Persons per 100 m of pavement.
  double walkers_per_100_m = 4.0;
};

[[nodiscard]] Plan plan_town(const WorldSpec& spec);
/// Nodes along each side of the city's grid.
inline constexpr std::size_t kCityRows = 9;
[[nodiscard]] Plan plan_city(const WorldSpec& spec);
[[nodiscard]] Plan plan_highway(const WorldSpec& spec);
[[nodiscard]] Plan plan_depot(const WorldSpec& spec);

/// Plots along all streets of a network, and their drives' lowered kerbs.
[[nodiscard]] std::vector<Plot> plan_plots(RoadNetwork& network, std::uint64_t seed);

/// Point beside a road: `out_m` beyond its pavement, on one side; and the heading along the road in
/// the direction of the nearest lane.
struct RoadsideFrame {
  Eigen::Vector2d point = Eigen::Vector2d::Zero();
  /// x along the nearest lane; y away from the carriageway would be at +90 degrees on the left of
  /// what drives there, so it is given apart.
  double heading_rad = 0.0;
};
/// @param out_m  from the edge of the carriageway, away from it.
[[nodiscard]] RoadsideFrame beside_road(const RoadEdge& edge, int side, double station_m,
                                        double out_m);
/// Upright frame there with y away from the carriageway, and x so that z is up.
[[nodiscard]] Eigen::Isometry3d T_world_roadside(const Terrain& terrain, const RoadEdge& edge,
                                                 int side, double station_m, double out_m);

/// Adds shapes once and places them often.
class Scenery {
 public:
  Scenery(World& world, std::uint64_t seed) : world_(world), seed_(seed) {}

  /// `count` variants of a shape, drawn by `make` from the seed and `stream`.
  std::vector<std::size_t> variants(std::size_t count, std::uint64_t stream,
                                    const std::function<Mesh(Random&)>& make);
  void place(std::size_t shape, const Eigen::Isometry3d& T_world_shape, double scale = 1.0);
  [[nodiscard]] World& world() { return world_; }
  [[nodiscard]] std::uint64_t seed() const { return seed_; }

 private:
  World& world_;
  std::uint64_t seed_;
};

/// Buildings, gardens, borders, and what stands on pavements.
void build_plots(Scenery& scenery, const Plan& plan, const WorldSpec& spec);
void furnish_streets(Scenery& scenery, const Plan& plan, const WorldSpec& spec);
void furnish_highway(Scenery& scenery, const Plan& plan, const WorldSpec& spec);
void furnish_depot(Scenery& scenery, const Plan& plan, const WorldSpec& spec);

/// What can move: parked along roads and in drives, driving, walking.
void park_vehicles(World& world, const Plan& plan, const WorldSpec& spec);
void add_traffic(World& world, const WorldSpec& spec, std::vector<Driven> driven);
void add_walkers(World& world, const Plan& plan, const WorldSpec& spec);
/// WorldSpec::busy: more two-wheelers and people in a plan; parked ones, groups and who crosses the
/// road; things by the kerb that look like them or like cars.
void make_busy(Plan& plan);
void add_crowd(World& world, const Plan& plan, const WorldSpec& spec);
void add_lookalikes(Scenery& scenery, const Plan& plan);
/// Bodies of this day, drawn once and used by many actors.
class BodyStock {
 public:
  BodyStock(World& world, std::uint64_t key) : world_(world), key_(key) {}
  /// An actor with one of the bodies of a kind; still, at no place yet.
  [[nodiscard]] Actor draw(BodyKind kind, Random& random);
  [[nodiscard]] Actor draw(const std::vector<std::pair<BodyKind, double>>& mix, Random& random);

 private:
  World& world_;
  std::uint64_t key_;
  std::map<BodyKind, std::vector<std::size_t>> bodies_;
};

/// SemanticKITTI class of a kind, standing or moving.
[[nodiscard]] std::uint32_t label_of(BodyKind kind, bool moves);

[[nodiscard]] inline std::uint64_t day_key(const WorldSpec& spec, Stream stream,
                                           std::uint64_t number = 0) {
  return key_of({spec.seed, static_cast<std::uint64_t>(spec.day),
                 static_cast<std::uint64_t>(stream), number});
}

}  // namespace stillmap::simulation
