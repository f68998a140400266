#pragma once

#include <cstdint>

#include "geometry/mesh.hpp"
#include "roads/terrain.hpp"

namespace stillmap::simulation {

/// What grows or lies beside the pavements.
struct GroundCover {
  Surface beside = Surface::kGrass;
  /// How rough it is, and the carriageway [m], as half the range of a uniform deviation.
  double beside_roughness_m = 0.06;
  double road_roughness_m = 0.013;
};

/// The ground as triangles, some 1 m large, cut along kerbs and the edges of pavements; with lane
/// markings 3 mm above it. Only where the terrain covers.
[[nodiscard]] Mesh make_ground(const Terrain& terrain, const RoadNetwork& network,
                               const GroundCover& cover, std::uint64_t seed);

}  // namespace stillmap::simulation
