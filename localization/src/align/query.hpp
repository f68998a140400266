#pragma once

#include <stillmap/localization/thinning.hpp>
#include <stillmap/maps/scan.hpp>

#include <Eigen/Core>

#include <cstddef>
#include <vector>

namespace stillmap::localization {

/// The points of a scan that are matched.
struct Query {
  /// In the lidar frame [m], spread evenly over the surfaces.
  std::vector<Eigen::Vector3f> points;
  /// One flag a point: stands above what is below it, so that it tells about x, y and yaw. The rest
  /// is ground, which is flat nearly everywhere and fits nearly everywhere.
  std::vector<char> stands;
  /// Indices of the standing points, ascending.
  std::vector<std::size_t> standing;
  /// A time for each point, relative to the scan's stamp [s], or empty: all at the stamp.
  std::vector<float> time_offsets_s;
};

/// One flag a point: stands above the lowest point of its column of 2 m. @param points  in the
/// lidar frame, within 500 m. @param R  turns them upright.
[[nodiscard]] std::vector<char> standing_flags(const std::vector<Eigen::Vector3f>& points,
                                               const Eigen::Matrix3f& R);

/// @param R_map_lidar  rotation of the prior: tells where up is.
[[nodiscard]] Query query_of(const ThinScan& scan, const Eigen::Matrix3d& R_map_lidar);

}  // namespace stillmap::localization
