#include "settle.hpp"

#include "registration.hpp"
#include "verdict.hpp"

#include <algorithm>

namespace stillmap::localization {

Place settle(std::span<const MapIndex::Level> levels, const Query& query,
             const Eigen::Isometry3d& T_index_lidar, float bend_share) {
  Place place{T_index_lidar};
  const std::size_t stride = std::max<std::size_t>(1, query.points.size() / 1000);
  for (const MapIndex::Level& level : levels) {
    if (&level == &levels.back() && levels.size() > 1) break;
    place.iterations += refine(level, query.points,
                               {.first_kernel_m = 0.6F * level.edge_m,
                                .last_kernel_m = 0.3F * level.edge_m,
                                .stride = stride,
                                .max_rounds = 4,
                                .bend_share = bend_share},
                               place.T_index_lidar);
  }
  const Support support = support_of(levels, query, place.T_index_lidar, stride);
  place.support = support.standing_ratio * support.known_ratio + 0.1 * support.inlier_ratio;
  return place;
}

}  // namespace stillmap::localization
