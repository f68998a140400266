#pragma once

#include "index/index_window.hpp"
#include "index/map_level.hpp"
#include "query.hpp"
#include "registration.hpp"

#include <Eigen/Geometry>

#include <memory>
#include <span>

namespace stillmap::localization {

/// A pose that may be the answer, and how much of the scan it explains.
struct Candidate {
  /// Relative to the origin of the window, or of the local map.
  Eigen::Isometry3d T_index_lidar;
  /// `Support::score` by some of the points.
  double score = 0.0;
  /// What of the map is around it; null in a local map.
  std::shared_ptr<const IndexWindow> window = nullptr;

  [[nodiscard]] Eigen::Isometry3d T_map_lidar() const { return window->to_map(T_index_lidar); }
};

/// `Support::score` of a pose by every `stride`-th point.
[[nodiscard]] double score_at(std::span<const MapIndex::Level> levels, const Query& query,
                              const Eigen::Isometry3d& T_index_lidar, std::size_t stride);

/// Refines a start from coarse to fine above the finest level, with few points: enough to tell good
/// places from bad ones.
/// @param levels  coarse to fine, at least one.
/// @param steps       Gauss-Newton steps are added to it.
/// @param bend_share  see `row_variance_m2`; 0 where the map is straight.
[[nodiscard]] Candidate refine_coarse(std::span<const MapIndex::Level> levels, const Query& query,
                                      const Eigen::Isometry3d& T_index_lidar, int& steps,
                                      float bend_share = kBendShare);

/// Refines a candidate on the finest level, with as few points, and measures its score again: what
/// repeats itself every metre or two looks alike on the coarser levels.
void refine_fine(std::span<const MapIndex::Level> levels, const Query& query, Candidate& candidate,
                 int& steps);

/// Refines a pose with all points on the finest level: first with a weight that favours near
/// points, then with all alike. Where the map is bent, the two differ, and the pose is moved
/// towards the one by near points.
/// @return from the pose by all points to the one by near points.
[[nodiscard]] Vector6d refine_final(const MapIndex::Level& finest, const Query& query,
                                    Eigen::Isometry3d& T_index_lidar, int& steps);

/// Residuals of all points at a pose, and their sums.
struct FinalRows {
  FinalRows(const MapIndex::Level& finest, const Query& query,
            const Eigen::Isometry3d& T_index_lidar, float bend_share = 0.0F);
  /// Sum of the shares of the kernel that the rows keep.
  [[nodiscard]] double weight() const;

  float kernel_m;
  Matches matches;
  const ResidualRows& rows;
  NormalEquations sums;
};

}  // namespace stillmap::localization
