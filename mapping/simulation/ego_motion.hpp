#pragma once

#include <Eigen/Geometry>

#include "road.hpp"

namespace stillmap::simulation {

/// Where the sensor's vehicle is: on the right lane, at some 8 m/s, a little faster and slower,
/// swaying a little.
class EgoMotion {
 public:
  explicit EgoMotion(double lidar_height_m) : lidar_height_m_(lidar_height_m) {}

  /// Length along the street driven since time 0 [m]; never decreasing.
  [[nodiscard]] static double driven_m(double time_s);
  [[nodiscard]] Eigen::Isometry3d T_world_lidar(const Road& road, double time_s) const;

 private:
  double lidar_height_m_;
};

}  // namespace stillmap::simulation
