#pragma once

#include <functional>
#include <vector>

#include "geometry/mesh.hpp"

namespace stillmap::simulation {

/// A round opening for a wheel in the side of a hull [m].
struct WheelArch {
  double x_m;
  double radius_m;
  double hub_height_m;
};

/// How a hull ends at its front or rear [m].
struct HullEnd {
  /// Over this way the hull narrows, by so much on either side.
  double reach_m = 0.5;
  double narrowing_m = 0.08;
  /// How far corners, upper edge and lower edge lie behind the bumper's middle.
  double bulge_m = 0.12;
  double lean_m = 0.10;
  double chin_m = 0.04;
};

/// Half the outline of a vehicle's cross section, from the middle of the underside to the middle of
/// the roof, is a chain of strips. Strip `r` lies between the outline's points `r` and `r + 1`.
enum HullStrip : int {
  kUnderside,
  kWellWall,
  kWellRoof,
  kLowerSide,
  kMiddleSide,
  kShoulder,
  kLowerPane,
  kUpperPane,
  kPaneFrame,
  kRoofEdge,
  kOuterRoof,
  kInnerRoof,
  kHullStrips
};

/// Shape of a smooth vehicle body: lines seen from the side, with a cross section fitted below them
/// at every place along x (x forward, y left, z up) [m].
struct Hull {
  /// (x, z) with rising x, straight in between: middle of roof, panes, bonnet and boot; lower edge
  /// of the side panes, which is kept below the top.
  std::vector<Eigen::Vector2d> top;
  std::vector<Eigen::Vector2d> belt;
  double half_width_m = 0.8;
  /// How far the side leans inward per metre above the belt.
  double tumblehome = 0.3;
  /// How much higher the roof's middle is than its edge.
  double crown_m = 0.06;
  double clearance_m = 0.17;
  double bumper_height_m = 0.5;
  /// How deep wheels are set in from the side.
  double well_m = 0.28;
  /// Shares of the height from belt to roof edge where the panes end and where they are divided.
  double pane_top = 0.9;
  double pane_middle = 0.5;
  std::vector<WheelArch> arches;
  HullEnd front;
  HullEnd rear;
  /// Places along x where the material of a strip changes.
  std::vector<double> cuts;

  [[nodiscard]] double front_x() const { return top.back().x(); }
  [[nodiscard]] double rear_x() const { return top.front().x(); }
  [[nodiscard]] double top_at(double x) const;
  [[nodiscard]] double belt_at(double x) const;
};

/// What the parts of a hull are made of. `side` is 1 on the left and -1 on the right, `share` is
/// how far from the middle (0) to the side (1).
struct HullMaterials {
  std::function<Surface(double x, int strip, double side)> side;
  std::function<Surface(double share, int strip)> front;
  std::function<Surface(double share, int strip)> rear;
};

/// Adds the closed skin of a hull. Wheels are left to the caller.
void add_hull(Mesh& mesh, const Hull& hull, const HullMaterials& materials);

/// Appends `parts` points of the arc to `end`, which rises `rise_m` above the straight way.
void append_arc(std::vector<Eigen::Vector2d>& line, const Eigen::Vector2d& end, double rise_m,
                int parts);

}  // namespace stillmap::simulation
