#pragma once

#include "geometry/mesh.hpp"

namespace stillmap::simulation {

/// A wheel that one can look through [m].
struct OpenWheel {
  double radius_m = 0.34;
  /// Half the width of the tyre, and about its height.
  double tyre_m = 0.020;
  double rim_depth_m = 0.018;
  double hub_radius_m = 0.025;
  double hub_width_m = 0.08;
  /// Far fewer than the 28 to 36 of a bicycle, and as much thicker.
  int spokes = 9;
  double spoke_radius_m = 0.003;
  /// How far it has rolled.
  double turn_rad = 0.0;
};

/// In the plane y = 0; the lowest point is a corner of the tread straight below the axle.
void add_open_wheel(Mesh& mesh, const Eigen::Vector3d& axle, const OpenWheel& wheel);

/// Strip of a mudguard around an axle, from one angle to another [rad]: 0 is ahead, pi/2 above.
struct Mudguard {
  double radius_m;
  double half_width_m;
  double from_rad;
  double to_rad;
};
void add_mudguard(Mesh& mesh, const Eigen::Vector3d& axle, const Mudguard& guard,
                  Material material);

/// Turns what is steered about its axis: `axis` points up along it, through `pivot`.
[[nodiscard]] Eigen::Isometry3d steered(const Eigen::Vector3d& pivot, const Eigen::Vector3d& axis,
                                        double angle_rad);

}  // namespace stillmap::simulation
