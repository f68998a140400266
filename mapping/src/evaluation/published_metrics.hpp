#pragma once

#include "evaluation/point_cells.hpp"

#include <Eigen/Core>

#include <cstddef>
#include <cstdint>
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

/// Scores of DynamicMap_Benchmark, 0 to 1; NaN where there is no truth of a kind.
struct BenchmarkScores {
  std::size_t truth_static = 0;
  std::size_t truth_dynamic = 0;
  /// Static truth points with a map point within 0.05 m.
  std::size_t static_kept = 0;
  /// Dynamic truth points without.
  std::size_t dynamic_removed = 0;
  /// static_kept / truth_static and dynamic_removed / truth_dynamic.
  double SA = 0.0;
  double DA = 0.0;
  /// sqrt(SA DA) and 2 SA DA / (SA + DA), 0 when both are 0.
  double AA = 0.0;
  double HA = 0.0;
};

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
/// Memory: some 28 bytes a map point, 13 bytes for each voxel of each scan, several times that in
/// erasor(). Same input, same bits, for any number of threads. Not safe from several threads.
/// @see Zhang, Duberg, Geng, Jia, Wang, Jensfelt, "A Dynamic Points Removal Benchmark in Point
///      Cloud Maps", ITSC 2023, eq. (1) to (3); Lim, Hwang, Myung, "ERASOR", RA-L 2021, section IV.
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
  struct Counts {
    std::size_t truth_static = 0;
    std::size_t truth_dynamic = 0;
    std::size_t static_kept = 0;
    std::size_t dynamic_removed = 0;
  };
  struct LabelledPoints {
    std::vector<Eigen::Vector3f> positions;
    std::vector<std::uint8_t> is_dynamic;
  };

  static LabelledPoints voxel_means(const PointCells& cells, std::span<const std::uint8_t> labels);
  void count(const TruthScan& scan);
  void keep_voxels(const TruthScan& scan);
  [[nodiscard]] std::vector<std::uint8_t> labels_of_map(const PointCells& truth) const;

  PointCells map_;
  /// Means of the map's 0.2 m voxels.
  std::vector<Eigen::Vector3f> map_means_;
  Counts counts_;
  /// Of all scans, one after the other.
  LabelledPoints scan_means_;
};

}  // namespace stillmap::mapping
