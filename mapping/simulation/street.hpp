#pragma once

#include <cstdint>
#include <vector>

#include "mesh.hpp"
#include "road.hpp"
#include "world.hpp"

/// The parts of the street that stay.
namespace stillmap::simulation {

/// Carriageway with crown, kerbs, pavements and rough gardens, over the whole road.
void add_ground(Mesh& mesh, const Road& road, std::uint64_t seed);

/// Houses on both sides, with varied heights, set-backs and gaps, and walls or hedges in front of
/// them.
void add_houses(Mesh& mesh, const Road& road, std::uint64_t seed);

/// Lamps and signs.
void add_poles(Mesh& mesh, const Road& road, std::uint64_t seed);

/// Shapes of trees and bushes: a trunk and a crown of single leaves, so that some rays get through.
[[nodiscard]] std::vector<Mesh> make_plants(std::uint64_t seed);

/// Places for them; `trees` and `bushes` are indices of shapes.
[[nodiscard]] std::vector<Placement> place_plants(const Road& road, std::uint64_t seed,
                                                  const std::vector<std::size_t>& trees,
                                                  const std::vector<std::size_t>& bushes);

}  // namespace stillmap::simulation
