#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::simulation {

/// A spinning sensor: one ring for each beam, a ray in each ring for each column.
struct Sensor {
  /// Angles above the horizontal [rad], top beam first.
  std::vector<double> elevations_rad;
  /// Rays of a full turn.
  std::size_t columns = 0;
  double min_range_m = 0.9;
  double max_range_m = 120.0;
  /// Standard deviation of a range [m].
  double range_noise_m = 0.02;
  /// Above the ground it stands on [m].
  double height_m = 1.73;
};

/// `hdl64`, `os1-64` or `vlp16`, with the beams that their makers publish; nothing for another
/// name.
[[nodiscard]] std::optional<Sensor> sensor_named(std::string_view name);

/// Names that `sensor_named` knows, parted by blanks.
[[nodiscard]] std::string sensor_names();

}  // namespace stillmap::simulation
