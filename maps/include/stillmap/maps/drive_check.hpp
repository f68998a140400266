#pragma once

#include <stillmap/maps/drive.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::maps {

/// Something that looks wrong with a drive, and what to do about it.
struct DriveFinding {
  /// Stable: frame_of_poses, map_not_level, poses_stand_still, poses_jump, coarse_positions, gaps,
  /// duplicates, sensor_upside_down, sensor_tilted, intensity_constant, millimetres, few_returns,
  /// no_poses, viewpoints_not_applied, times_not_taken, times_doubted.
  std::string code;
  std::string what;
  std::string remedy;
};

/// How the sensor stands on the ground, estimated from the ground around it.
struct SensorMounting {
  /// Takes points of the lidar frame to one whose z is up from the ground; yaw is zero.
  Eigen::Matrix3d R_level_lidar = Eigen::Matrix3d::Identity();
  /// Of the sensor over the ground [m].
  double height_m = 0.0;
  /// Between the sensor's z and the ground's normal [rad], in [0, pi].
  double tilt_rad = 0.0;
  /// Scans in which the ground was found.
  std::size_t scans = 0;
};

/// Time between scans.
struct ScanPeriods {
  double median_s = 0.0;
  double longest_s = 0.0;
  /// Scan before the longest.
  std::size_t longest_after = 0;
  /// Longer than 2.5 times the median.
  std::size_t gaps = 0;
};

/// How much of one scan lies on another (what stands, not the ground), in [0, 1], median over pairs
/// of scans that lie apart.
struct PoseOverlap {
  double given = 0.0;
  /// As if the sensor had not moved.
  double without = 0.0;
  /// As the best other reading of the poses, and what that is; empty when none was tried.
  double other = 0.0;
  std::string other_reading;
  std::size_t pairs = 0;
};

struct DriveCheck {
  std::vector<DriveFinding> findings;
  std::optional<SensorMounting> mounting;
  std::optional<ScanPeriods> periods;
  std::optional<PoseOverlap> overlap;
  /// Lowest and highest, where scans have any.
  std::optional<std::array<float, 2>> intensities;
  std::size_t scans_read = 0;
};

/// Looks for what commonly goes wrong with drives, in some twenty scans spread over it, and of
/// recordings in up to 200 more. The same for the same drive. @throws as `Drive::read`.
[[nodiscard]] DriveCheck check_drive(const Drive& drive);

}  // namespace stillmap::maps
