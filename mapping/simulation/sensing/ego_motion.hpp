#pragma once

#include <Eigen/Geometry>

#include "scenarios/world.hpp"

namespace stillmap::simulation {

/// Our own vehicle: follows its motion on the ground, and rolls, pitches and heaves on its springs.
class EgoMotion {
 public:
  /// @param world  must outlive it. @param lidar_height_m  over ground, of the usual place.
  /// @param T_usual_lidar  identity for a lidar in the usual place.
  EgoMotion(const World& world, double lidar_height_m,
            const Eigen::Isometry3d& T_usual_lidar = Eigen::Isometry3d::Identity())
      : world_(world), height_m_(lidar_height_m), T_usual_lidar_(T_usual_lidar) {}

  [[nodiscard]] const Eigen::Isometry3d& T_usual_lidar() const { return T_usual_lidar_; }

  /// At any time that our motion covers [s].
  [[nodiscard]] Eigen::Isometry3d T_world_lidar(double time_s) const;

 private:
  const World& world_;
  double height_m_;
  Eigen::Isometry3d T_usual_lidar_;
};

}  // namespace stillmap::simulation
