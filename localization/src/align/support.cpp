#include "support.hpp"

#include <cmath>

namespace stillmap::localization {
namespace {

/// Deviation of a point that lies on a surface of the map: noise of the sensor and of the map's
/// poses [m].
constexpr float kSurfaceSigmaM = 0.07F;
constexpr float kMaxSurface2 = 9.0F;

bool is_known(std::span<const MapIndex::Level> levels, const Eigen::Vector3f& p) {
  return levels.front().nearest(p, 1.0F).voxel != nullptr;
}

}  // namespace

Support support_of(std::span<const MapIndex::Level> levels, const Query& query,
                   const Eigen::Isometry3d& T_index_lidar, std::size_t stride) {
  const Eigen::Isometry3f T = T_index_lidar.cast<float>();
  const MapIndex::Level& fine = levels.back();
  std::size_t inliers = 0, near = 0, standing = 0, known = 0, standing_inliers = 0;
  double squares = 0.0;
  const auto place = [&](std::size_t i) -> Eigen::Vector3f { return T * query.points[i * stride]; };
  const auto count = [&](std::size_t i, const MapIndex::Level::Nearest& nearest) {
    const Eigen::Vector3f p = place(i);
    const bool inlier = nearest.voxel != nullptr && nearest.distance2 < kMaxSurface2;
    if (nearest.voxel != nullptr) ++near;
    if (inlier) {
      ++inliers;
      const double across = static_cast<double>(nearest.voxel->axis0.dot(p - nearest.mean));
      squares += across * across;
    }
    if (query.stands[i * stride] == 0) return;
    ++standing;
    if (inlier) ++standing_inliers;
    if (inlier || is_known(levels, p)) ++known;
  };
  const std::size_t seen = (query.points.size() + stride - 1) / stride;
  fine.for_each_nearest(seen, kSurfaceSigmaM * kSurfaceSigmaM, place, count);
  const auto share = [](std::size_t part, std::size_t whole) {
    return whole == 0 ? 0.0 : static_cast<double>(part) / static_cast<double>(whole);
  };
  Support support;
  support.inlier_ratio = share(inliers, seen);
  support.known_inlier_ratio = share(inliers, near);
  support.rmse_m = inliers == 0 ? 0.0 : std::sqrt(squares / static_cast<double>(inliers));
  support.known_standing = known * stride;
  support.known_ratio = share(known, standing);
  support.standing_ratio = share(standing_inliers, known);
  return support;
}

}  // namespace stillmap::localization
