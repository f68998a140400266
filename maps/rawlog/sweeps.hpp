#pragma once

#include <mrpt/obs/CObservation.h>

#include <optional>

#include "record_output.hpp"

namespace stillmap::maps::rawlog {

/// What an observation of a cloud saw; no points where it holds none here, as when they lie in a
/// file of their own, which is never opened. @return nothing for other observations.
[[nodiscard]] std::optional<Sweep> sweep_of(mrpt::obs::CObservation& observation);

}  // namespace stillmap::maps::rawlog
