#pragma once

#include <stillmap/maps/deskew.hpp>
#include <stillmap/maps/drive.hpp>

#include <Eigen/Core>

#include <optional>

namespace stillmap::mapping {

/// Mean twist (tx ty tz rx ry rz) [m/s, rad/s] in the lidar frame at scan `index`, from the poses
/// of the scans before and after it. @return nothing without poses or neighbours in time.
[[nodiscard]] std::optional<Eigen::Matrix<double, 6, 1>> twist_at(const maps::Drive& drive,
                                                                  std::size_t index);

}  // namespace stillmap::mapping
