#pragma once

#include <stillmap/localization/thinning.hpp>
#include <stillmap/maps/scan.hpp>

#include <Eigen/Core>

#include <cstddef>
#include <vector>

namespace stillmap::localization {

/// A scan thinned for matching.
struct Query {
  /// At most `kMaxQueryPoints` points [m] in the lidar frame, spread evenly over the surfaces.
  std::vector<Eigen::Vector3f> points;
  /// One flag a point: stands above what is below it, so that it tells about x, y and yaw. The rest
  /// is ground, which is flat nearly everywhere and fits nearly everywhere.
  std::vector<char> stands;
  /// Indices of the standing points, ascending.
  std::vector<std::size_t> standing;
  /// A time for each point, relative to the scan's stamp [s], or empty: all at the stamp.
  std::vector<float> time_offsets_s;
};

inline constexpr std::size_t kMaxQueryPoints = 4000;

/// One flag a point: stands above the lowest point of its column of 2 m. @param points  in the
/// lidar frame, within 500 m. @param R  turns them upright.
[[nodiscard]] std::vector<char> standing_flags(const std::vector<Eigen::Vector3f>& points,
                                               const Eigen::Matrix3f& R);

/// One point a cell of 0.5 m (the first in the scan's order), then every k-th so that the limit
/// holds. Points beyond 500 m are left out: no lidar of ours sees them, and they would overflow the
/// grid.
/// @param R_map_lidar    rotation of the prior: tells where up is.
/// @param own_vehicle_m  see `AlignerOptions`.
[[nodiscard]] Query thin(const maps::PointCloud& scan_lidar, const Eigen::Matrix3d& R_map_lidar,
                         double own_vehicle_m = kOwnVehicleM);

}  // namespace stillmap::localization
