#pragma once

#include <stillmap/mapping/progress.hpp>
#include <stillmap/maps/box.hpp>

#include <Eigen/Geometry>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "bodies/bodies.hpp"
#include "geometry/mesh.hpp"
#include "roads/path.hpp"
#include "roads/road_network.hpp"
#include "roads/terrain.hpp"

namespace stillmap::simulation {

/// A shape that stands in several places.
struct Placement {
  /// Index into World::shapes.
  std::size_t shape = 0;
  /// Rotation, translation and one scale for all axes.
  Eigen::Affine3d T_world_shape = Eigen::Affine3d::Identity();
};

/// Something that can move: parked or on its way.
struct Actor {
  /// Index into World::bodies.
  std::size_t body = 0;
  maps::ObjectClass object_class = maps::ObjectClass::kCar;
  /// SemanticKITTI class: another one for what moves during the drive.
  std::uint32_t label = 10;
  /// Brightness of its paint against the usual, in [0, 2).
  double paint = 1.0;
  /// What moves has a motion; what stands has its place.
  std::optional<Motion> motion;
  Eigen::Isometry3d T_world_body = Eigen::Isometry3d::Identity();
  /// Feet that it stands on [m]; 0 for persons, who stay upright.
  double wheelbase_m = 2.6;
  double track_m = 1.5;

  [[nodiscard]] bool moves() const { return motion.has_value(); }
  [[nodiscard]] bool present(double time_s) const { return !motion || motion->covers(time_s); }
};

/// Everything a ray can meet, and our own way through it. World frame: x east, y north, z up.
struct World {
  std::shared_ptr<RoadNetwork> network;
  std::unique_ptr<Terrain> terrain;
  /// The ground, markings and all.
  Mesh ground;
  /// Buildings, walls: what is there once.
  Mesh buildings;
  /// Plants, poles, pieces of fences: what stands in many places.
  std::vector<Mesh> shapes;
  std::vector<Placement> placements;
  std::vector<Body> bodies;
  std::vector<Actor> actors;
  /// Our own vehicle.
  Body own_body;
  Motion own_motion;
  /// Near where we are at time 0, upright and along our route: the same on every day.
  Eigen::Isometry3d T_world_start = Eigen::Isometry3d::Identity();
};

/// Which world, which day, and how long one drives through it.
struct WorldSpec {
  /// One of `scenario_names()`.
  std::string scenario = "town";
  std::uint64_t seed = 1;
  int day = 1;
  /// Building sites stand where there were none, and some fences are gone.
  bool change = false;
  /// Share of the parking places along the roads that are taken; none = the scenario's own.
  std::optional<double> parked_share = std::nullopt;
  /// Many more two-wheelers and people, and more things by the kerb that look like them: for
  /// training.
  bool busy = false;
  double duration_s = 10.0;
  /// Our vehicle stands beside the lane that it would drive on, at one pose.
  bool standing = false;
  /// How far a sensor sees [m]; nothing farther from our way is made.
  double reach_m = 120.0;
  /// May be none.
  const mapping::CancelFlag* cancel = nullptr;
};

/// "town city highway depot".
[[nodiscard]] std::string scenario_names();
[[nodiscard]] bool is_scenario(const std::string& name);

/// @throws std::invalid_argument for an unknown scenario, mapping::Cancelled.
/// @note The world that stays follows from scenario, seed and change; how long one drives only
/// decides how much of it is made.
[[nodiscard]] World make_world(const WorldSpec& spec);

/// Where an actor stands at a time.
[[nodiscard]] Eigen::Isometry3d T_world_actor(const World& world, const Actor& actor,
                                              double time_s);
/// Which of its body's postures it has then.
[[nodiscard]] std::size_t posture_of(const World& world, const Actor& actor, double time_s);

}  // namespace stillmap::simulation
