#pragma once

#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/ground_plane.hpp>

#include <array>
#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "drives/pose_readings.hpp"

namespace stillmap::maps {

/// What is kept of a scan that was looked at.
struct SampledScan {
  std::size_t index = 0;
  std::optional<GroundPlane> ground;
  StandingPoints standing;
  double median_range_m = 0.0;
  std::size_t points = 0;
  std::size_t points_in_file = 0;
  /// Of its points, or without points.
  bool has_times = false;
  /// As `Scan::times_note`.
  std::string times_note;
  std::optional<std::array<float, 2>> intensities;
};

/// @throws as `Drive::read`.
[[nodiscard]] SampledScan sample_scan(const Drive& drive, std::size_t index);

/// What of a cloud stands around the sensor.
[[nodiscard]] StandingPoints standing_points(const PointCloud& cloud);

/// Scans to look at, spread over a drive; each with one after it that lies a metre or more, or 5
/// deg, away by the poses, where there are poses and there is such a scan among the next 30.
struct SamplePair {
  std::size_t first = 0;
  std::optional<std::size_t> second;
};
[[nodiscard]] std::vector<SamplePair> choose_samples(const Drive& drive);
/// The same by other poses. @param pose_of  nothing where a scan has none.
[[nodiscard]] std::vector<SamplePair> choose_samples(
    std::size_t scans, const std::function<std::optional<Eigen::Isometry3d>(std::size_t)>& pose_of);

}  // namespace stillmap::maps
