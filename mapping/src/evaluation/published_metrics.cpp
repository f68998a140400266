#include "evaluation/published_metrics.hpp"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Farthest map point that still holds a truth point [m]: `export_eval_pcd ... 0.05`.
constexpr double kSamePointM = 0.05;
/// A ball of kSamePointM touches at most 8 of these [m].
constexpr double kMapCellM = 2.0 * kSamePointM;
/// Farthest truth that counts for SA, DA [m]: `max_range` of `extract_semkitti.py`.
constexpr float kTruthRangeM = 50.0F;
/// Nearest truth that counts for PR, RR [m]: `CAR_BODY_SIZE` of `mapgen.hpp`.
constexpr float kCarBodyM = 2.7F;
/// Voxels of PR, RR [m].
constexpr double kVoxelM = 0.2;
/// `DETERMINISTIC_INLIER_THR` of `analysis.py`, 0.1732 m: half the diagonal of a voxel.
constexpr double kInlierM = kVoxelM * std::numbers::sqrt3 / 2.0;

double share(std::size_t part, std::size_t whole) {
  if (whole == 0) return std::numeric_limits<double>::quiet_NaN();
  return static_cast<double>(part) / static_cast<double>(whole);
}

double harmonic_mean(double a, double b) {
  const double sum = a + b;
  return sum == 0.0 ? 0.0 : 2.0 * a * b / sum;
}

std::vector<Eigen::Vector3f> means_of(const PointCells& cells) {
  std::vector<Eigen::Vector3f> means(cells.cells());
  tbb::parallel_for(std::size_t{0}, means.size(), [&](std::size_t cell) {
    const PointCells::Range range = cells.cell(cell);
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (std::uint32_t i = range.begin; i < range.end; ++i) {
      sum += cells.in_cell_order()[i].cast<double>();
    }
    means[cell] = (sum / static_cast<double>(range.end - range.begin)).cast<float>();
  });
  return means;
}

}  // namespace

PublishedMetrics::PublishedMetrics(std::vector<Eigen::Vector3f> map_points)
    : map_(std::move(map_points), kMapCellM),
      map_means_(means_of(PointCells(map_.in_cell_order(), kVoxelM))) {}

void PublishedMetrics::add_scan(const TruthScan& scan) {
  if (scan.positions.size() != scan.is_dynamic.size()) {
    throw std::invalid_argument("is_dynamic: " + std::to_string(scan.is_dynamic.size()) +
                                " flags for " + std::to_string(scan.positions.size()) + " points");
  }
  keep_voxels(scan);
  count(scan);
}

void PublishedMetrics::count(const TruthScan& scan) {
  using Range = tbb::blocked_range<std::size_t>;
  const Counts added = tbb::parallel_reduce(
      Range(0, scan.positions.size(), 1024), Counts{},
      [&](const Range& range, Counts counts) {
        for (std::size_t i = range.begin(); i < range.end(); ++i) {
          const Eigen::Vector3f& p = scan.positions[i];
          if (!((p - scan.sensor).norm() < kTruthRangeM)) continue;
          const bool kept = map_.any_within(p, kSamePointM);
          if (scan.is_dynamic[i] != 0) {
            ++counts.truth_dynamic;
            counts.dynamic_removed += kept ? 0 : 1;
          } else {
            ++counts.truth_static;
            counts.static_kept += kept ? 1 : 0;
          }
        }
        return counts;
      },
      [](const Counts& a, const Counts& b) {
        return Counts{a.truth_static + b.truth_static, a.truth_dynamic + b.truth_dynamic,
                      a.static_kept + b.static_kept, a.dynamic_removed + b.dynamic_removed};
      });
  counts_.truth_static += added.truth_static;
  counts_.truth_dynamic += added.truth_dynamic;
  counts_.static_kept += added.static_kept;
  counts_.dynamic_removed += added.dynamic_removed;
}

PublishedMetrics::LabelledPoints PublishedMetrics::voxel_means(
    const PointCells& cells, std::span<const std::uint8_t> labels) {
  LabelledPoints means;
  means.positions = means_of(cells);
  means.is_dynamic.resize(means.positions.size());
  tbb::parallel_for(std::size_t{0}, means.positions.size(), [&](std::size_t i) {
    // A voxel's mean has a point of that voxel within half the diagonal, so one is always found.
    const auto nearest = cells.nearest(means.positions[i], kVoxelM);
    means.is_dynamic[i] = nearest && labels[nearest->point] != 0 ? 1 : 0;
  });
  return means;
}

void PublishedMetrics::keep_voxels(const TruthScan& scan) {
  LabelledPoints outside;
  for (std::size_t i = 0; i < scan.positions.size(); ++i) {
    const Eigen::Vector3f from_sensor = scan.positions[i] - scan.sensor;
    if (from_sensor.head<2>().norm() < kCarBodyM) continue;
    outside.positions.push_back(scan.positions[i]);
    outside.is_dynamic.push_back(scan.is_dynamic[i]);
  }
  const PointCells cells(std::move(outside.positions), kVoxelM);
  const LabelledPoints means = voxel_means(cells, outside.is_dynamic);
  scan_means_.positions.insert(scan_means_.positions.end(), means.positions.begin(),
                               means.positions.end());
  scan_means_.is_dynamic.insert(scan_means_.is_dynamic.end(), means.is_dynamic.begin(),
                                means.is_dynamic.end());
}

BenchmarkScores PublishedMetrics::benchmark() const {
  BenchmarkScores scores;
  scores.truth_static = counts_.truth_static;
  scores.truth_dynamic = counts_.truth_dynamic;
  scores.static_kept = counts_.static_kept;
  scores.dynamic_removed = counts_.dynamic_removed;
  scores.SA = share(scores.static_kept, scores.truth_static);
  scores.DA = share(scores.dynamic_removed, scores.truth_dynamic);
  scores.AA = std::sqrt(scores.SA * scores.DA);
  scores.HA = harmonic_mean(scores.SA, scores.DA);
  return scores;
}

std::vector<std::uint8_t> PublishedMetrics::labels_of_map(const PointCells& truth) const {
  // A map voxel near enough to keep a truth voxel is within kInlierM of that one's mean, and so
  // within 2 kInlierM of a labelled point. Without one, the label is never looked at.
  std::vector<std::uint8_t> labels(map_means_.size());
  tbb::parallel_for(std::size_t{0}, labels.size(), [&](std::size_t i) {
    const auto nearest = truth.nearest(map_means_[i], 2.0 * kInlierM);
    labels[i] = nearest ? scan_means_.is_dynamic[nearest->point] : std::uint8_t{0};
  });
  return labels;
}

ErasorScores PublishedMetrics::erasor() const {
  const PointCells scans(scan_means_.positions, kVoxelM);
  const LabelledPoints truth = voxel_means(scans, scan_means_.is_dynamic);
  const std::vector<std::uint8_t> map_labels = labels_of_map(scans);
  const PointCells map(map_means_, kVoxelM);
  ErasorScores scores;
  for (std::size_t i = 0; i < truth.positions.size(); ++i) {
    const bool dynamic = truth.is_dynamic[i] != 0;
    ++(dynamic ? scores.truth_dynamic : scores.truth_static);
    const auto nearest = map.nearest(truth.positions[i], kInlierM);
    if (!nearest || !(std::sqrt(nearest->squared_distance_m2) < kInlierM)) continue;
    if ((map_labels[nearest->point] != 0) != dynamic) continue;
    ++(dynamic ? scores.dynamic_kept : scores.static_kept);
  }
  scores.PR = share(scores.static_kept, scores.truth_static);
  scores.RR = 1.0 - share(scores.dynamic_kept, scores.truth_dynamic);
  scores.F1 = harmonic_mean(scores.PR, scores.RR);
  return scores;
}

}  // namespace stillmap::mapping
