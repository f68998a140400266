#pragma once

#include "fuzz_target.hpp"

#include <stillmap/maps/scan_file.hpp>

#include <cmath>

namespace stillmap::fuzz {

/// What `maps::PointCloud` says of every cloud that has passed a reader.
inline void require_whole(const maps::PointCloud& cloud) {
  const std::size_t n = cloud.size();
  require(cloud.intensities.empty() || cloud.intensities.size() == n, "an intensity a point");
  require(cloud.time_offsets_s.empty() || cloud.time_offsets_s.size() == n, "a time a point");
  require(cloud.file_indices.empty() || cloud.file_indices.size() == n, "a file index a point");
  for (std::size_t i = 0; i < n; ++i) {
    require(cloud.positions[i].allFinite(), "points are finite");
    require(cloud.positions[i] != Eigen::Vector3f::Zero(), "no point is 'no return'");
    require(i == 0 || cloud.file_index(i) > cloud.file_index(i - 1), "file indices ascend");
  }
  for (const float intensity : cloud.intensities)
    require(std::isfinite(intensity), "intensities are finite");
  for (const float time_s : cloud.time_offsets_s)
    require(std::abs(time_s) <= 1.0F, "times lie within 1 s of the stamp");
}

/// What `maps::decode_scan` says of its result. @param max_points  that it was called with.
inline void require_decoded(const maps::DecodedScan& scan, std::size_t max_points) {
  require_whole(scan.cloud);
  require(scan.points_in_file <= max_points, "no more points than allowed");
  require(
      scan.cloud.size() + scan.dropped.non_finite + scan.dropped.zero_range + scan.dropped.unsure ==
          scan.points_in_file,
      "every point is kept or counted");
}

}  // namespace stillmap::fuzz
