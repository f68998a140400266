#pragma once

#include "core/point_cells.hpp"

#include <Eigen/Core>

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// A scan with truth. Same frame and origin as the map points [m].
struct TruthScan {
  /// Where the sensor stood.
  Eigen::Vector3f sensor = Eigen::Vector3f::Zero();
  /// N points.
  std::span<const Eigen::Vector3f> positions;
  /// N flags, 1 = dynamic; the caller says whether that means moving or movable.
  std::span<const std::uint8_t> is_dynamic;
};

/// Farthest map point that still holds a truth point, for SA and DA [m].
inline constexpr double kSamePointM = 0.05;
/// Farthest truth from its sensor that counts for SA and DA [m].
inline constexpr double kTruthRangeM = 50.0;
/// Edge of the voxels of PR and RR [m].
inline constexpr double kErasorVoxelM = 0.2;

/// What SA, DA, AA and HA are made of.
struct BenchmarkCounts {
  std::size_t truth_static = 0;
  std::size_t truth_dynamic = 0;
  /// Static truth points with a map point within 0.05 m.
  std::size_t static_kept = 0;
  /// Dynamic truth points without.
  std::size_t dynamic_removed = 0;
};

/// Scores of DynamicMap_Benchmark, 0 to 1; NaN where there is no truth of a kind.
struct BenchmarkScores : BenchmarkCounts {
  /// static_kept / truth_static and dynamic_removed / truth_dynamic.
  double SA = 0.0;
  double DA = 0.0;
  /// sqrt(SA DA) and 2 SA DA / (SA + DA), 0 when both are 0.
  double AA = 0.0;
  double HA = 0.0;
};

[[nodiscard]] BenchmarkScores benchmark_scores(const BenchmarkCounts& counts);

/// Scores of ERASOR, 0 to 1; NaN where there is no truth of a kind. Counts are voxels of 0.2 m.
struct ErasorScores {
  std::size_t truth_static = 0;
  std::size_t truth_dynamic = 0;
  /// Voxels of the truth with a map voxel of the same kind nearest to them and below 0.1732 m.
  std::size_t static_kept = 0;
  std::size_t dynamic_kept = 0;
  /// static_kept / truth_static and 1 - dynamic_kept / truth_dynamic.
  double PR = 0.0;
  double RR = 0.0;
  /// 2 PR RR / (PR + RR), 0 when both are 0.
  double F1 = 0.0;
};

/// Means of the 0.2 m voxels of points [m], by place.
[[nodiscard]] std::vector<Eigen::Vector3f> erasor_voxel_means(std::vector<Eigen::Vector3f> points);

/// The truth side of PR, RR and F1, see `PublishedMetrics`: collected once, then any number of maps
/// are judged with it. Points carry a kind below 256, and which kinds are dynamic is said when a
/// map is judged.
///
/// Memory: 13 bytes for each voxel of each scan, and what 20 m x 20 m of them take while a map is
/// judged.
class ErasorTruth {
 public:
  /// @param sensor, positions as in `TruthScan`. @param kinds  one a point.
  /// @throws std::invalid_argument when a point is not finite or kinds are not as many.
  void add_scan(const Eigen::Vector3f& sensor, std::span<const Eigen::Vector3f> positions,
                std::span<const std::uint8_t> kinds);

  /// @param map_means   of the map's 0.2 m voxels. @param is_dynamic  a flag for each kind.
  [[nodiscard]] ErasorScores scores(const std::vector<Eigen::Vector3f>& map_means,
                                    const std::array<std::uint8_t, 256>& is_dynamic) const;

 private:
  struct Points {
    std::vector<Eigen::Vector3f> positions;
    std::vector<std::uint8_t> kinds;
  };
  /// 100 x 100 voxels each, so that no voxel lies in two.
  using Tile = std::array<std::int64_t, 2>;
  using MeansByTile = std::map<Tile, std::vector<Eigen::Vector3f>>;

  static Tile tile_of(const Eigen::Vector3f& p);
  static Points voxel_means(const PointCells& cells, std::span<const std::uint8_t> kinds);
  void score_tile(const Tile& tile, const MeansByTile& map,
                  const std::array<std::uint8_t, 256>& is_dynamic, ErasorScores& scores) const;
  [[nodiscard]] Points around(const Tile& tile) const;

  /// Means of the scans' voxels.
  std::map<Tile, Points> means_;
};

/// The two published judgements of a cleaned map, from labelled scans that come one at a time.
///
/// **SA, DA, AA, HA** as DynamicMap_Benchmark's programs compute them (`export_eval_pcd.cpp`,
/// `evaluate_all.py`): every truth point is called static when the nearest map point is at most
/// 0.05 m away, dynamic otherwise. Truth beyond 50 m of its sensor does not count
/// (`extract_semkitti.py`). The programs also call unlabelled points within 3 m of the sensor
/// dynamic: that is for the caller.
///
/// **PR, RR, F1** as ERASOR's programs compute them (`mapgen.hpp`, `erasor_utils.cpp`,
/// `analysis.py`). Truth: points nearer than 2.7 m to the sensor, seen from above, go; each scan
/// becomes means of 0.2 m voxels, then all of them together again; a mean has the label of the
/// point nearest to it. Map: means of 0.2 m voxels, likewise labelled by the nearest of the
/// scans' means, as `fill_removert_intensity.cpp` does for maps that carry no labels. A voxel of
/// the truth is kept when the nearest one of the map is nearer than 0.2 sqrt(3) / 2 m and has its
/// label.
///
/// Departures: distances are computed in double; map points beyond 50 m of every sensor are
/// there, while the benchmark cuts what methods are given.
///
/// Memory: some 28 bytes a map point, and that of `ErasorTruth`. Same input, same bits, for any
/// number of threads. Not safe from several threads.
/// @see Zhang, Duberg, Geng, Jia, Wang, Jensfelt, "A Dynamic Points Removal Benchmark in Point
///      Cloud Maps", ITSC 2023 (SA, DA, AA); Lim, Hwang, Myung,
///      "ERASOR", RA-L 6(2), 2021 (preservation rate PR, rejection rate RR).
class PublishedMetrics {
 public:
  /// @param map_points finite, within 100 km of the frame's origin [m]; may be empty.
  /// @throws std::invalid_argument when not.
  explicit PublishedMetrics(std::vector<Eigen::Vector3f> map_points);

  /// @throws std::invalid_argument when a point is not finite or the flags are not as many.
  void add_scan(const TruthScan& scan);

  /// Of the scans added so far.
  [[nodiscard]] BenchmarkScores benchmark() const;
  [[nodiscard]] ErasorScores erasor() const;

 private:
  void count(const TruthScan& scan);

  PointCells map_;
  /// Means of the map's 0.2 m voxels.
  std::vector<Eigen::Vector3f> map_means_;
  BenchmarkCounts counts_;
  ErasorTruth truth_;
};

}  // namespace stillmap::mapping
