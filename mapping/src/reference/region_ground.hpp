#pragma once

#include <Eigen/Core>

#include <cstdint>
#include <vector>

namespace stillmap::mapping {

/// Region-wise ground plane fitting (R-GPF) of ERASOR: the plane of a region's
/// lowest points, refined three times; what is less than 0.15 m above it is ground.
///
/// Numbers are those of the program for KITTI (`gf_num_lpr` 20, `gf_th_seeds_height` 0.5,
/// `gf_iter` 3, `gf_dist_thr` 0.15, the lowest 5 points left out as reflections from below). The
/// normal is turned upward; the program takes it as its solver returns it.
/// @param points  of one region [m], z up.
/// @return flags, 1 = ground; all 0 for fewer than 3 points.
[[nodiscard]] std::vector<std::uint8_t> region_ground(const std::vector<Eigen::Vector3f>& points);

}  // namespace stillmap::mapping
