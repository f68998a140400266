#pragma once

#include <stillmap/mapping/cleaning.hpp>

#include <cstdint>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// Defaults are those of OctoMap, and of the benchmark that the method is compared in.
struct OctomapOptions {
  /// Edge of a voxel [m], in [0.01, 10].
  double voxel_m = 0.1;
  /// P(occupied | a ray ended here), in (0.5, 1). More keeps more.
  double hit_probability = 0.7;
  /// P(occupied | a ray passed here), in (0, 0.5). Less removes more.
  double miss_probability = 0.4;
  /// Bounds of a voxel's probability, 0 < min < 0.5 < max < 1: how many scans overrule how many.
  double min_probability = 0.12;
  double max_probability = 0.97;

  [[nodiscard]] std::vector<std::string> violations() const;
};

/// Points in voxels that OctoMap takes for free belong to what moved; ground stays.
///
/// From scan to scan, in their order, a voxel's log-odds of being occupied rise where a ray ended
/// in it, else fall where one passed, between two bounds (the paper's "Probabilistic Sensor Fusion"
/// and clamping update policy); above 0 it is occupied. Ground points only clear what their rays
/// passed before them, and ground points of the map stay, as in "octomap with ground fitting" of
/// the benchmark.
///
/// Reproduced: model, parameters and order, by the library's own octree; rays to the middles of
/// voxels, one for each, and ends before passages within a scan, as its `insertPointCloud` with
/// `discretize`.
/// Departures: the ground is the one given, by whatever found it, instead of one plane a scan; only
/// voxels that hold a map point are in the tree, since no other is asked for, which changes no
/// answer and saves most of time and memory; rays are walked by `VoxelRay`, the library's
/// `computeRayKeys` but for its rounding to floats; no filter of outliers; rays longer than 500 m
/// are left out; a point in a voxel that no ray met stays.
///
/// Memory: 50 to 80 bytes a voxel with a map point, 0.7 to 1.4 GB for a kilometre of simulated
/// streets at 0.1 m; some 10 MB a thread, and its scans.
/// @see Hornung, Wurm, Bennewitz, Stachniss, Burgard, "OctoMap: An Efficient Probabilistic 3D
///      Mapping Framework Based on Octrees", Autonomous Robots 34, 2013; Zhang et al., "A Dynamic
///      Points Removal Benchmark in Point Cloud Maps", ITSC 2023.
class OctomapCleaner : public Cleaner {
 public:
  /// @throws std::invalid_argument naming each broken option.
  explicit OctomapCleaner(const OctomapOptions& options = {});
  /// @throws std::invalid_argument as well when a pose is too far from the origin, or a map larger
  /// than the library's 65,536 voxels.
  [[nodiscard]] std::vector<std::uint8_t> moved(const CleaningPoints& points,
                                                const ScanSource& scans,
                                                const ProgressCallback& progress,
                                                const CancelFlag& cancel) const override;

 private:
  OctomapOptions options_;
};

}  // namespace stillmap::mapping
