#pragma once

#include <memory>
#include <vector>

#include "sensing/sensor.hpp"

namespace stillmap::simulation {

/// One laser of a spinning sensor.
struct Laser {
  double elevation_rad = 0.0;
  /// Where it looks against the sensor's heading, counter-clockwise [rad].
  double azimuth_offset_rad = 0.0;
  /// When it fires within its column [s], >= 0 and less than a column lasts.
  double time_offset_s = 0.0;
  /// How far to the left of its direction, and above the sensor's origin, it sits [m].
  double left_m = 0.0;
  double up_m = 0.0;
};

/// A sensor that turns once a period. It faces backward when a scan starts and ends, and forward at
/// the stamp.
struct SpinningSpec {
  SensorProperties properties;
  /// In any order.
  std::vector<Laser> lasers;
  /// Firings of each laser in a turn.
  std::size_t columns = 0;
  /// Seen from above.
  bool clockwise = true;
  /// Step of the encoder that azimuths are read from [rad]; 0 = none. Rays leave along the
  /// rounded azimuth.
  double encoder_step_rad = 0.0;
};

/// Its rays lie ring by ring, the top one first, and within a ring by azimuth from straight ahead
/// counter-clockwise once around. That is how the points lie in KITTI's files (2011_09_26, drive
/// 0013: 64 runs of rising azimuth, each from 0 to 360 degrees).
[[nodiscard]] std::unique_ptr<Sensor> make_spinning_sensor(SpinningSpec spec);

}  // namespace stillmap::simulation
