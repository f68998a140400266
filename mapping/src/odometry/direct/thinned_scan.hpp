#pragma once

#include <stillmap/mapping/odometry.hpp>
#include <stillmap/maps/scan.hpp>

#include <cstdint>
#include <string>

namespace stillmap::mapping {

/// A scan at two densities, not deskewed, with the points' times where it has any.
struct ThinnedScan : Odometry::Prepared {
  std::int64_t stamp_ns = 0;
  std::string source;
  /// What the map is made of.
  maps::PointCloud dense;
  /// What is aligned.
  maps::PointCloud sparse;
  /// See `is_shell` and `content_of`.
  bool shell = false;
  std::uint64_t content = 0;
};

[[nodiscard]] ThinnedScan thinned(const maps::Scan& scan);

}  // namespace stillmap::mapping
