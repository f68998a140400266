#pragma once

#include <Eigen/Core>

#include <vector>

#include "sensing/simulated_scan.hpp"

namespace stillmap::simulation {

/// Points as the sensor would have measured them, had it stood still where it was at the stamp:
/// p_stamp = T_world_lidar(stamp)^-1 T_world_lidar(stamp + t) p, with the true path. Between
/// milliseconds the path counts as straight, which at 10 m/s^2 is off by 1.3 um.
[[nodiscard]] std::vector<Eigen::Vector3f> positions_at_stamp(const TruePath& T_world_lidar,
                                                              double stamp_s,
                                                              const LabelledPoints& points);

}  // namespace stillmap::simulation
