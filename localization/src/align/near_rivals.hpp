#pragma once

#include "index/map_level.hpp"
#include "query.hpp"
#include "residual_rows.hpp"

#include <Eigen/Geometry>

namespace stillmap::localization {

/// Looks for second optima that explain the scan about as well, 0.1 to 0.7 m away: the other face
/// of a thin wall, the next fold of what repeats itself. An answer may be that of the wrong one.
/// @param H         of all points at the pose. @param kernel_m  of the final rows.
/// @return covariance that reaches them; zero where there is none.
[[nodiscard]] Matrix6d covariance_of_near_rivals(const MapIndex::Level& level, const Query& query,
                                                 const Eigen::Isometry3d& T_index_lidar,
                                                 const Matrix6d& H, float kernel_m);

}  // namespace stillmap::localization
