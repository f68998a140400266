#pragma once

#include <memory>

#include "sensing/sensor.hpp"

namespace stillmap::simulation {

/// Livox Avia in its non-repetitive mode: 6 lasers behind two prisms that turn at rates without a
/// common measure, so that each scan draws other petals and the gaps between them fill over time.
/// Its rays lie in the order of time.
[[nodiscard]] std::unique_ptr<Sensor> make_avia();

}  // namespace stillmap::simulation
