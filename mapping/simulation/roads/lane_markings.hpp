#pragma once

#include "geometry/mesh.hpp"
#include "roads/terrain.hpp"

namespace stillmap::simulation {

/// Adds dashed and solid lines between lanes and beside them, and stop lines at crossings.
void add_lane_markings(Mesh& mesh, const Terrain& terrain, const RoadNetwork& network);

}  // namespace stillmap::simulation
