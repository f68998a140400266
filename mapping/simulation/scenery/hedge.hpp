#pragma once

#include "geometry/mesh.hpp"
#include "geometry/random.hpp"

namespace stillmap::simulation {

/// Trimmed hedge from the origin to (length_m, 0, 0): an uneven body of dense twigs and, over it,
/// leaves in clumps.
[[nodiscard]] Mesh make_hedge(double length_m, double height_m, Random& random);

}  // namespace stillmap::simulation
