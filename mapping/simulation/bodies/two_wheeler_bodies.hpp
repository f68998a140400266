#pragma once

#include "bodies/bodies.hpp"
#include "geometry/random.hpp"

namespace stillmap::simulation {

/// Parked on its stand: leans to the left, mostly with the front wheel turned.
[[nodiscard]] Body make_motorcycle(Random& random);
/// With somebody on it, as it goes.
[[nodiscard]] Body make_motorcyclist(Random& random);
/// Parked on its stand; of the class of cyclists, as there is none for bicycles.
[[nodiscard]] Body make_bicycle(Random& random);
/// Somebody on a bicycle: stopped with the left foot on the ground, then the phases of one turn of
/// the cranks.
[[nodiscard]] Body make_cyclist(Random& random);

}  // namespace stillmap::simulation
