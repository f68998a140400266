#pragma once

#include "odometry/loam/features.hpp"

#include <vector>

namespace stillmap::mapping::loam {

/// The first feature of each voxel, in their order.
[[nodiscard]] std::vector<Feature> thinned(const std::vector<Feature>& features, double voxel_m);

}  // namespace stillmap::mapping::loam
