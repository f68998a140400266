#pragma once

#include "geometry/mesh.hpp"
#include "geometry/random.hpp"

namespace stillmap::simulation {

enum class BuildingKind {
  /// One or two floors, porch or garage, gable or hip roof.
  kHouse,
  /// Row of dwellings or flats of two to six floors, balconies, bays.
  kFlats,
  /// Shop windows on the ground floor, awnings, flats above.
  kShop,
  /// Industrial hall: large panels, gates, few windows, flat roof.
  kHall,
};

/// Measures of a building [m].
struct BuildingShape {
  BuildingKind kind = BuildingKind::kFlats;
  double width = 12.0;
  double depth = 10.0;
  int floors = 3;
};

/// Adds a building: its front on y = 0 of the frame, x along the street from -width / 2 to
/// width / 2, y away from the street, z up from the ground; walls reach 1.5 m into the ground. Rays
/// that go through a window meet a curtain or the room's back wall.
void add_building(Mesh& mesh, const Eigen::Isometry3d& T_world_front, const BuildingShape& shape,
                  Random& random);

}  // namespace stillmap::simulation
