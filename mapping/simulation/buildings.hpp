#pragma once

#include "mesh.hpp"
#include "random.hpp"

namespace stillmap::simulation {

/// Measures of a house [m].
struct BuildingShape {
  double width = 12.0;
  double depth = 10.0;
  int floors = 3;
};

/// Adds a house: its front on y = 0 of the frame, x along the street from -width / 2, y away from
/// it, z up from the ground. Windows and doors are set back, some floors have balconies, the roof
/// is a gable.
void add_building(Mesh& mesh, const Eigen::Isometry3d& T_world_front, const BuildingShape& shape,
                  Random& random);

}  // namespace stillmap::simulation
