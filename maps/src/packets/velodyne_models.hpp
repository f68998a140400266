#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::maps {

/// Where a laser of a Velodyne points, and what its ranges are off by.
struct VelodyneLaser {
  double elevation_rad = 0.0;
  /// Subtracted from the packet's azimuth.
  double azimuth_rad = 0.0;
  double range_m = 0.0;
  /// At 2.4 m along x and 1.93 m along y of the sensor; used with `two_points`.
  double near_x_m = 0.0;
  double near_y_m = 0.0;
  bool two_points = false;
  double vertical_offset_m = 0.0;
  double horizontal_offset_m = 0.0;
};

/// How a model packs its firings into packets of 1206 bytes.
struct VelodyneModel {
  std::string_view name;
  double range_step_m = 0.002;
  /// Lasers of one firing sequence; 32 to a block, or twice 16.
  std::size_t lasers = 0;
  /// From one sequence to the next [us].
  double sequence_us = 0.0;
  /// From one group of lasers that fire together to the next [us]; 0 where it is not documented.
  double group_us = 0.0;
  std::size_t lasers_at_once = 1;
  /// Whether lasers have the makers' usual angles, so that no calibration is needed.
  bool has_usual_angles = true;
};

/// The model by the last byte of its packets (VLP-16 manual 63-9243, 9.3.1.6).
/// @return null for one that is not known. HDL-64E has no such byte: `velodyne_hdl64e`.
[[nodiscard]] const VelodyneModel* velodyne_model(std::uint8_t factory_byte);
[[nodiscard]] const VelodyneModel& velodyne_hdl64e();

/// Lasers with the angles of the model's manual. Empty for HDL-64E, whose lasers differ from sensor
/// to sensor.
[[nodiscard]] std::vector<VelodyneLaser> usual_lasers(const VelodyneModel& model);

/// Lasers by a calibration of velodyne_pointcloud (`64e_utexas.yaml`, as its gen_calibration.py
/// makes of the sensor's db.xml).
/// @throws InputError naming the file, the line and what is needed.
[[nodiscard]] std::vector<VelodyneLaser> read_velodyne_calibration(
    const std::filesystem::path& file);

}  // namespace stillmap::maps
