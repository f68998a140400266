#pragma once

#include <stillmap/maps/scan_file.hpp>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "packets/ouster_sensor.hpp"

namespace stillmap::maps {

/// Makes the points of a turn from its packets, in the sensor's frame: x ahead, y left, z up.
///
/// Points of columns that the sensor marks as not valid are left out. Intensity is the signal, as
/// in the clouds of Ouster's driver, or the reflectivity where the profile has no signal. Of two
/// returns both are taken.
class OusterSweep {
 public:
  /// @param stamp_ns  of the scan, by the sensor's clock: times of points count from it.
  /// @param name  for messages.
  OusterSweep(const OusterSensor& sensor, std::int64_t stamp_ns, std::string name);

  /// @throws CalibrationError for a packet of another size than the metadata's sensor sends.
  void add(std::span<const std::byte> packet);

  /// "No return" is dropped and counted. Times are left out, with a note, if a column lies more
  /// than a second from the stamp.
  [[nodiscard]] DecodedScan finish() &&;

 private:
  void add_column(std::span<const std::byte> column);

  const OusterSensor* sensor_;
  std::int64_t stamp_ns_;
  std::string name_;
  PointCloud cloud_;
  /// The first column that is too far from the stamp [s].
  std::optional<double> far_s_;
};

}  // namespace stillmap::maps
