#include "settle.hpp"

#include "registration.hpp"
#include "verdict.hpp"

#include <algorithm>

namespace stillmap::localization {
namespace {

std::size_t stride_of(const Query& query) {
  return std::max<std::size_t>(1, query.points.size() / 1000);
}

}  // namespace

double support_at(std::span<const MapIndex::Level> levels, const Query& query,
                  const Eigen::Isometry3d& T_index_lidar, std::size_t stride) {
  const Support support = support_of(levels, query, T_index_lidar, stride);
  return support.standing_ratio * support.known_ratio + 0.1 * support.inlier_ratio;
}

Place settle(std::span<const MapIndex::Level> levels, const Query& query,
             const Eigen::Isometry3d& T_index_lidar, float bend_share) {
  Place place{T_index_lidar};
  for (const MapIndex::Level& level : levels) {
    if (&level == &levels.back() && levels.size() > 1) break;
    place.iterations += refine(level, query.points,
                               {.first_kernel_m = 0.6F * level.edge_m,
                                .last_kernel_m = 0.3F * level.edge_m,
                                .stride = stride_of(query),
                                .max_rounds = 4,
                                .bend_share = bend_share},
                               place.T_index_lidar);
  }
  place.support = support_at(levels, query, place.T_index_lidar, stride_of(query));
  return place;
}

void sharpen(std::span<const MapIndex::Level> levels, const Query& query, float bend_share,
             Place& place) {
  const MapIndex::Level& level = levels.back();
  place.iterations += refine(level, query.points,
                             {.first_kernel_m = 0.6F * level.edge_m,
                              .last_kernel_m = 0.2F * level.edge_m,
                              .stride = stride_of(query),
                              .max_rounds = 6,
                              .bend_share = bend_share},
                             place.T_index_lidar);
  place.support = support_at(levels, query, place.T_index_lidar, stride_of(query));
}

}  // namespace stillmap::localization
