#pragma once

#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/pose_disagreement.hpp>

#include <Eigen/Core>

#include <compare>
#include <cstdint>
#include <span>
#include <vector>

namespace stillmap::localization {

/// How far a map is bent or torn in a column of 8 m: what the poses there that it was made from
/// disagree by, at most, beyond what odometry itself is off by.
struct OwnErrorColumn {
  /// From the map's origin on.
  std::int32_t x = 0, y = 0;
  maps::PoseDisagreement largest;
};
static_assert(sizeof(OwnErrorColumn) == 16);

/// Columns where there is something to say, by x, then y. @throws maps::InputError.
[[nodiscard]] std::vector<OwnErrorColumn> own_errors_of(const maps::MapPackage& map);

/// The largest within some 45 m. @param columns  by x, then y.
/// @param p  relative to the map's origin [m].
[[nodiscard]] maps::PoseDisagreement own_error_near(std::span<const OwnErrorColumn> columns,
                                                    const Eigen::Vector3d& p);

}  // namespace stillmap::localization
