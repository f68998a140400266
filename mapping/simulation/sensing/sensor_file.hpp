#pragma once

#include <filesystem>

#include "sensing/spinning_sensor.hpp"

namespace stillmap::simulation {

/// A spinning sensor from a JSON file:
///
///     {"format": "stillmap-sensor", "version": 1, "name": "mine", "rate_hz": 10,
///      "direction": "clockwise", "columns": 1024, "min_range_m": 0.5, "max_range_m": 100,
///      "range_noise_m": 0.02, "divergence_rad": 0.003, "height_m": 1.7,
///      "beams": [{"elevation_deg": 15}, {"elevation_deg": 13, "azimuth_offset_deg": 1.5}]}
///
/// `direction` is clockwise or counter_clockwise, seen from above; beams may stand in any order,
/// and each may have `azimuth_offset_deg` (counter-clockwise) and `time_offset_s` (within its
/// column). Optional: `half_range_m`, `ring_bias_m`, `echo_separation_m`, `range_step_m`, as in
/// SensorProperties; `half_range_m` is `max_range_m` unless given.
/// @throws maps::InputError naming file, key, value and what was expected, also for keys that are
/// not known; maps::StorageError when it cannot be read.
[[nodiscard]] SpinningSpec read_sensor_file(const std::filesystem::path& file);

}  // namespace stillmap::simulation
