#pragma once

#include <stillmap/mapping/map_consistency.hpp>
#include <stillmap/mapping/progress.hpp>
#include <stillmap/maps/map_package.hpp>

#include <Eigen/Geometry>

#include <cstdint>
#include <functional>

namespace stillmap::mapping {

/// Which tiles of a map of some frame are looked at; empty: all.
using TileChoice = std::function<bool(maps::TileId)>;

/// How much of one version's ground another one has, both seen from above, in cells of 1 m.
struct GroundCoverage {
  /// Shares of the cells with ground within 2 m, and within 15 m, of the path of the first, or of
  /// the places of one that no drive made; NaN where it has none.
  double driven = 0.0;
  double near_path = 0.0;
  std::uint64_t driven_cells = 0;
  std::uint64_t near_path_cells = 0;
};

/// Ground is measured, projected or filled. Roads over each other count once.
/// @param T_map_previous  takes points of the previous version to the new one's frame.
/// @param tiles           of both; with a choice their frames are one.
/// @throws maps::InputError for a broken package, Cancelled.
[[nodiscard]] GroundCoverage ground_coverage(const maps::MapPackage& previous,
                                             const maps::MapPackage& map,
                                             const Eigen::Isometry3d& T_map_previous,
                                             const CancelFlag& cancel,
                                             const TileChoice& tiles = {});

/// What of the map that keeps everything is not in the new one although nothing says that it moved.
struct StaticLoss {
  std::uint64_t points = 0;
  std::uint64_t lost = 0;
  /// NaN where there is no such point.
  [[nodiscard]] double rate() const;
};

/// A point of the keep map counts when it was measured, was seen for at least 1 s, and lies in no
/// box (grown by 0.3 m, which covers what a build grows them by) of an object that the new map says
/// it removed. It is lost when no measured point of the new map is within 0.2 m, or two voxels.
/// There is no truth in this: what stood for a second and was rightly taken by free space counts
/// as lost, so the figure is an upper bound; what a wrong box took does not count, and localization
/// has to tell.
/// @param T_map_keep  takes points of the keep map to the new one's frame.
/// @param tiles       of the new map, and of the keep map: with a choice their frames are one.
/// @throws maps::InputError for a broken package, or a keep map without histories; Cancelled.
[[nodiscard]] StaticLoss static_loss(const maps::MapPackage& keep, const maps::MapPackage& map,
                                     const Eigen::Isometry3d& T_map_keep,
                                     const ProgressCallback& progress, const CancelFlag& cancel,
                                     const TileChoice& tiles = {});

/// How well the scans of two versions agree, where both have points.
struct ConsistencyChange {
  /// Over the same cells. Thickness: of those that are planar in either, so that a wall that became
  /// too thick for a plane is not left out. Entropy: mean of the cells' means.
  MapConsistency previous, map;
};

/// Nothing is compared of maps of different voxels, since these decide how much of the thickness is
/// averaged away.
/// @param T_map_previous  takes points of the previous version to the new one's frame.
/// @param threads         0 = all cores. The result is the same bits for any number.
/// @param tiles           of the new version.
/// @throws maps::InputError for a broken package, Cancelled.
[[nodiscard]] ConsistencyChange consistency_change(const maps::MapPackage& previous,
                                                   const maps::MapPackage& map,
                                                   const Eigen::Isometry3d& T_map_previous,
                                                   int threads, const ProgressCallback& progress,
                                                   const CancelFlag& cancel,
                                                   const TileChoice& tiles = {});

}  // namespace stillmap::mapping
