#pragma once

#include <Eigen/Geometry>

#include "scenarios/world.hpp"

namespace stillmap::simulation {

/// Our own vehicle: follows its motion on the ground, and rolls, pitches and heaves on its springs.
class EgoMotion {
 public:
  /// @param world  must outlive it. @param lidar_height_m  over ground.
  EgoMotion(const World& world, double lidar_height_m) : world_(world), height_m_(lidar_height_m) {}

  /// At any time that our motion covers [s].
  [[nodiscard]] Eigen::Isometry3d T_world_lidar(double time_s) const;

 private:
  const World& world_;
  double height_m_;
};

}  // namespace stillmap::simulation
