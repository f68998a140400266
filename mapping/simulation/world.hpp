#pragma once

#include <stillmap/maps/box.hpp>

#include <Eigen/Geometry>

#include <cstdint>
#include <vector>

#include "mesh.hpp"
#include "road.hpp"

namespace stillmap::simulation {

/// A shape that stands in several places.
struct Placement {
  /// Index into World::shapes.
  std::size_t shape = 0;
  /// Rotation, translation and one scale for all axes.
  Eigen::Affine3d T_world_shape = Eigen::Affine3d::Identity();
};

/// Something that can move, and how it does.
struct Actor {
  /// Index into World::shapes.
  std::size_t shape = 0;
  maps::ObjectClass object_class = maps::ObjectClass::kCar;
  /// SemanticKITTI class: another one for what moves.
  std::uint32_t label = 10;
  /// Where it is at time 0, and how fast it goes along the street [m, m/s]; 0 for what is parked.
  double s_m = 0.0;
  double speed_mps = 0.0;
  double d_m = 0.0;
  /// Against the street's direction [rad].
  double yaw_rad = 0.0;

  [[nodiscard]] bool moves() const { return speed_mps != 0.0; }
  [[nodiscard]] double s_at(double time_s) const { return s_m + speed_mps * time_s; }
};

/// Everything a ray can meet.
struct World {
  Road road;
  /// Ground, houses, poles, walls, in the world's frame.
  Mesh ground_and_buildings;
  std::vector<Mesh> shapes;
  /// Trees and bushes.
  std::vector<Placement> plants;
  std::vector<Actor> actors;
};

/// Which world, which day, and the part of the street that must be there.
struct WorldSpec {
  std::uint64_t seed = 1;
  int day = 1;
  /// Range of s that the sensor passes, from 0 [m], and how long that takes [s].
  double length_m = 100.0;
  double duration_s = 10.0;
};

/// A street between houses. The world without its actors is the same on every day.
[[nodiscard]] World make_town(const WorldSpec& spec);

/// Where an actor stands at a time.
[[nodiscard]] Eigen::Isometry3d T_world_actor(const World& world, const Actor& actor,
                                              double time_s);

}  // namespace stillmap::simulation
