#include "support.hpp"

#include <algorithm>
#include <cmath>

namespace stillmap::localization {
namespace {

/// Deviation of a point that lies on a surface of the map: noise of the sensor and of the map's
/// poses [m].
constexpr float kSurfaceSigmaM = 0.07F;
constexpr float kMaxSurface2 = 9.0F;

double share(std::size_t part, std::size_t whole) {
  return whole == 0 ? 0.0 : static_cast<double>(part) / static_cast<double>(whole);
}

/// Points that have been looked at.
struct Counts {
  std::size_t seen = 0, inliers = 0, near = 0, standing = 0, known = 0, standing_inliers = 0;
  double squares = 0.0;

  void add(const MapIndex::Level& coarsest, const Eigen::Vector3f& p,
           const MapIndex::Level::Nearest& nearest, bool stands) {
    const bool inlier = nearest.voxel != nullptr && nearest.distance2 < kMaxSurface2;
    ++seen;
    if (nearest.voxel != nullptr) ++near;
    if (inlier) {
      ++inliers;
      const double across = static_cast<double>(nearest.voxel->axis0.dot(p - nearest.mean));
      squares += across * across;
    }
    if (!stands) return;
    ++standing;
    if (inlier) ++standing_inliers;
    if (inlier || coarsest.has_any_near(p)) ++known;
  }
};

/// Some of a scan's points at a pose.
class Placed {
 public:
  Placed(const Query& query, const Eigen::Isometry3d& T_index_lidar, std::size_t stride)
      : query_(query), T_(T_index_lidar.cast<float>()), stride_(stride) {}

  [[nodiscard]] std::size_t size() const { return (query_.points.size() + stride_ - 1) / stride_; }
  [[nodiscard]] bool stands(std::size_t i) const { return query_.stands[i * stride_] != 0; }
  /// Adds the points `first` to `end - 1`.
  void count(std::span<const MapIndex::Level> levels, std::size_t first, std::size_t end,
             Counts& counts) const {
    levels.back().for_each_nearest(
        end - first, kSurfaceSigmaM * kSurfaceSigmaM,
        [&](std::size_t i) -> Eigen::Vector3f { return T_ * query_.points[(first + i) * stride_]; },
        [&](std::size_t i, const Eigen::Vector3f& p, const MapIndex::Level::Nearest& nearest) {
          counts.add(levels.front(), p, nearest, stands(first + i));
        });
  }

 private:
  const Query& query_;
  Eigen::Isometry3f T_;
  std::size_t stride_;
};

Support support_by(const Counts& counts, std::size_t stride) {
  Support support;
  support.inlier_ratio = share(counts.inliers, counts.seen);
  support.known_inlier_ratio = share(counts.inliers, counts.near);
  support.rmse_m =
      counts.inliers == 0 ? 0.0 : std::sqrt(counts.squares / static_cast<double>(counts.inliers));
  support.known_standing = counts.known * stride;
  support.known_ratio = share(counts.known, counts.standing);
  support.standing_ratio = share(counts.standing_inliers, counts.known);
  return support;
}

}  // namespace

Support support_of(std::span<const MapIndex::Level> levels, const Query& query,
                   const Eigen::Isometry3d& T_index_lidar, std::size_t stride) {
  const Placed points(query, T_index_lidar, stride);
  Counts counts;
  points.count(levels, 0, points.size(), counts);
  return support_by(counts, stride);
}

double score_above(double least, std::span<const MapIndex::Level> levels, const Query& query,
                   const Eigen::Isometry3d& T_index_lidar, std::size_t stride) {
  constexpr double kRounding = 1e-9;
  const Placed points(query, T_index_lidar, stride);
  std::size_t standing = 0;
  for (std::size_t i = 0; i < points.size(); ++i) standing += points.stands(i) ? 1 : 0;
  Counts counts;
  for (std::size_t first = 0; first < points.size(); first += MapIndex::Level::kBatch) {
    points.count(levels, first, std::min(points.size(), first + MapIndex::Level::kBatch), counts);
    // Were all that are left on the map's surfaces.
    Support most;
    most.standing_ratio = 1.0;
    most.known_ratio = share(counts.standing_inliers + standing - counts.standing, standing);
    most.inlier_ratio = share(counts.inliers + points.size() - counts.seen, points.size());
    if (most.score() + kRounding < least) return 0.0;
  }
  return support_by(counts, stride).score();
}

}  // namespace stillmap::localization
