#pragma once

#include "bodies/bodies.hpp"

namespace stillmap::simulation {

/// A rigid truck of two or three axles, 7 to 11 m long.
[[nodiscard]] Mesh make_truck(Random& random);
/// A tractor with a semi-trailer of 13.6 m, 16.5 m long together (the limits of Directive
/// 96/53/EC).
[[nodiscard]] Mesh make_articulated_truck(Random& random);
/// A city bus of about 12 m, doors on its right.
[[nodiscard]] Mesh make_bus(Random& random);
/// A semi-trailer standing on its legs.
[[nodiscard]] Mesh make_parked_semi_trailer(Random& random);
/// A trailer without its vehicle: of a car, a caravan, or a semi-trailer.
[[nodiscard]] Mesh make_trailer(Random& random);

}  // namespace stillmap::simulation
