#pragma once

#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/scan.hpp>

#include <Eigen/Core>

#include <optional>

namespace stillmap::mapping {

/// Mean twist (tx ty tz rx ry rz) [m/s, rad/s] in the lidar frame at scan `index`, from the poses
/// of the scans before and after it. @return nothing without poses or neighbours in time.
[[nodiscard]] std::optional<Eigen::Matrix<double, 6, 1>> twist_at(const maps::Drive& drive,
                                                                  std::size_t index);

/// Moves every point to the scan's stamp: p <- exp(twist * time_offset) p. Does nothing without
/// per-point times.
void deskew(maps::PointCloud& cloud, const Eigen::Matrix<double, 6, 1>& twist_lidar);

}  // namespace stillmap::mapping
