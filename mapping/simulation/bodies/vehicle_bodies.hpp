#pragma once

#include "bodies/bodies.hpp"

namespace stillmap::simulation {

/// @param kind  kSmallCar, kSaloon, kEstate or kSuv.
[[nodiscard]] Mesh make_car(BodyKind kind, Random& random);
/// A delivery van: panelled, or with windows and benches behind them.
[[nodiscard]] Mesh make_van(Random& random);

}  // namespace stillmap::simulation
