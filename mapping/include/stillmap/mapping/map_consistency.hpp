#pragma once

#include <stillmap/mapping/progress.hpp>
#include <stillmap/maps/map_package.hpp>

#include <cstdint>
#include <limits>
#include <string>

namespace stillmap::mapping {

/// How thick the flat surfaces of one kind are.
struct SurfaceThickness {
  /// Cells of 0.5 m with enough points to tell, and those of them that hold a plane.
  std::uint64_t cells = 0;
  std::uint64_t planar_cells = 0;
  /// Over the planar cells: root mean square distance of a cell's points from its plane [m]; NaN
  /// without one.
  double median_m = std::numeric_limits<double>::quiet_NaN();
  double p95_m = std::numeric_limits<double>::quiet_NaN();

  /// NaN without a cell.
  [[nodiscard]] double planar_share() const;
};

/// How well the scans of a map agree with each other. Needs no truth: where poses are wrong, walls
/// are thick and what lies near a point is spread out. The formulas, and where they depart from
/// MapEval, are in mapping/evaluation.md.
struct MapConsistency {
  /// Of the differential entropies of the normal distributions that fit the points within 0.3 m (or
  /// 3 voxels) of every fourth point [nat]; NaN without one.
  double mean_map_entropy = std::numeric_limits<double>::quiet_NaN();
  std::uint64_t entropy_points = 0;
  /// Of points that the build did not call ground: walls, and all else that is flat.
  SurfaceThickness walls;
  SurfaceThickness ground;
};

/// Reads a package tile by tile; memory does not grow with the map.
/// @param threads  0 = all cores. The result is the same bits for any number.
/// @throws maps::InputError for a broken package, Cancelled.
/// @see Hu et al., "MapEval: Towards Unified, Robust and Efficient SLAM Map Evaluation Framework",
/// RA-L 2025; Droeschel, Stueckler, Behnke, "Local multi-resolution representation for 6D motion
/// estimation and mapping with a continuously rotating 3D laser scanner", ICRA 2014.
[[nodiscard]] MapConsistency map_consistency(const maps::MapPackage& map, int threads,
                                             const ProgressCallback& progress,
                                             const CancelFlag& cancel);

/// The object `consistency` of a build's and an evaluation's report; keys as in
/// mapping/evaluation.md. NaN becomes null.
[[nodiscard]] std::string to_json(const MapConsistency& consistency);

}  // namespace stillmap::mapping
