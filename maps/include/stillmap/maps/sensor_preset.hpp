#pragma once

#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/scan.hpp>

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::maps {

/// What is known of a sensor beyond its scans: angles from its data sheet, stamps from its ROS
/// driver.
struct SensorPreset {
  std::string_view name;
  /// Lowest and highest beam over the sensor's xy plane [deg].
  double lowest_deg = 0.0;
  double highest_deg = 0.0;
  std::size_t lasers = 0;
  /// Where in its sweep a turning sensor's driver takes the stamp: 0 at the start, 1 at the end;
  /// nothing for one that does not turn.
  std::optional<double> stamp_at;
  /// Points nearer than this are what carries the sensor [m], where that is no car; else nothing.
  std::optional<double> min_range_m;
  /// Beyond this points are few or wrong [m], where that is nearer than for other sensors.
  std::optional<double> max_range_m;
};

[[nodiscard]] std::span<const SensorPreset> sensor_presets();

/// @throws InputError naming it and those that are known.
[[nodiscard]] const SensorPreset& sensor_preset(std::string_view name);

/// Names of sensors that a scan may be of, by the angles that its points span and their number;
/// none where no preset fits, several where they are alike (16 lasers of Velodyne and RoboSense).
[[nodiscard]] std::vector<std::string> guess_sensors(const Scan& scan);

/// The drive with times for points of scans that have none, where the sensor turns and the points
/// lie in their files in the order in which they were fired; `Drive::open` does so for
/// `DRIVE?sensor=NAME`. Layouts whose points were brought to one instant before (KITTI odometry,
/// key frames), and those that tell times by themselves, stay as they are.
[[nodiscard]] Drive with_sensor(const Drive& drive, const SensorPreset& sensor);

/// What a drive was taken with by the words behind its path, `DRIVE?sensor=NAME`; null without.
/// @throws InputError for an unknown name.
[[nodiscard]] const SensorPreset* sensor_in_words(const std::filesystem::path& root);

}  // namespace stillmap::maps
