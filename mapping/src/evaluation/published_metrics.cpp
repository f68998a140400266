#include "evaluation/published_metrics.hpp"

#include "core/share_of.hpp"

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

// kSamePointM: `export_eval_pcd ... 0.05`; kTruthRangeM: `max_range` of `extract_semkitti.py`.

/// A ball of kSamePointM touches at most 8 of these [m].
constexpr double kMapCellM = 2.0 * kSamePointM;
/// Nearest truth that counts for PR, RR [m]: `CAR_BODY_SIZE` of `mapgen.hpp`.
constexpr float kCarBodyM = 2.7F;
constexpr double kVoxelM = kErasorVoxelM;
constexpr std::int64_t kTileVoxels = 100;
/// A truth voxel is kept by a map voxel within kInlierM, whose label comes from a point within
/// twice that: nothing farther from a tile matters to it [m].
constexpr float kTileMarginM = 0.6F;
/// `DETERMINISTIC_INLIER_THR` of `analysis.py`, 0.1732 m: half the diagonal of a voxel.
constexpr double kInlierM = kVoxelM * std::numbers::sqrt3 / 2.0;

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

BenchmarkScores benchmark_scores(const BenchmarkCounts& counts) {
  BenchmarkScores scores{counts};
  scores.SA = share_of(scores.static_kept, scores.truth_static);
  scores.DA = share_of(scores.dynamic_removed, scores.truth_dynamic);
  scores.AA = std::sqrt(scores.SA * scores.DA);
  scores.HA = harmonic_mean(scores.SA, scores.DA);
  return scores;
}

std::vector<Eigen::Vector3f> erasor_voxel_means(std::vector<Eigen::Vector3f> points) {
  return means_of(PointCells(std::move(points), kVoxelM));
}

ErasorTruth::Tile ErasorTruth::tile_of(const Eigen::Vector3f& p) {
  const auto axis = [](float x) {
    // By the voxel, as PointCells finds it, so that rounding cannot part a voxel.
    const auto voxel =
        static_cast<std::int64_t>(std::floor(static_cast<double>(x) * (1.0 / kVoxelM)));
    const std::int64_t tile = voxel / kTileVoxels;
    return voxel % kTileVoxels < 0 ? tile - 1 : tile;
  };
  return {axis(p.x()), axis(p.y())};
}

ErasorTruth::Points ErasorTruth::voxel_means(const PointCells& cells,
                                             std::span<const std::uint8_t> kinds) {
  Points means;
  means.positions = means_of(cells);
  means.kinds.resize(means.positions.size());
  tbb::parallel_for(std::size_t{0}, means.positions.size(), [&](std::size_t i) {
    // A voxel's mean has a point of that voxel within half the diagonal, so one is always found.
    const auto nearest = cells.nearest(means.positions[i], kVoxelM);
    means.kinds[i] = nearest ? kinds[nearest->point] : std::uint8_t{0};
  });
  return means;
}

void ErasorTruth::add_scan(const Eigen::Vector3f& sensor,
                           std::span<const Eigen::Vector3f> positions,
                           std::span<const std::uint8_t> kinds) {
  if (positions.size() != kinds.size()) {
    throw std::invalid_argument("kinds: " + std::to_string(kinds.size()) + " for " +
                                std::to_string(positions.size()) + " points");
  }
  Points outside;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const Eigen::Vector3f from_sensor = positions[i] - sensor;
    if (from_sensor.head<2>().norm() < kCarBodyM) continue;
    outside.positions.push_back(positions[i]);
    outside.kinds.push_back(kinds[i]);
  }
  const PointCells cells(std::move(outside.positions), kVoxelM);
  const Points means = voxel_means(cells, outside.kinds);
  for (std::size_t i = 0; i < means.positions.size(); ++i) {
    Points& tile = means_[tile_of(means.positions[i])];
    tile.positions.push_back(means.positions[i]);
    tile.kinds.push_back(means.kinds[i]);
  }
}

namespace {

/// Whether a point lies in a tile or so near to it that it matters.
bool is_near(const std::array<std::int64_t, 2>& tile, const Eigen::Vector3f& p) {
  constexpr auto kEdgeM = static_cast<double>(kTileVoxels) * kVoxelM;
  const auto near_axis = [](std::int64_t cell, float x) {
    const double from_low = static_cast<double>(x) - static_cast<double>(cell) * kEdgeM;
    return from_low >= -kTileMarginM && from_low <= kEdgeM + kTileMarginM;
  };
  return near_axis(tile[0], p.x()) && near_axis(tile[1], p.y());
}

/// The tile and those around it.
template <typename Visit>
void for_each_neighbour(const std::array<std::int64_t, 2>& tile, const Visit& visit) {
  for (std::int64_t x = -1; x <= 1; ++x) {
    for (std::int64_t y = -1; y <= 1; ++y)
      visit(std::array<std::int64_t, 2>{tile[0] + x, tile[1] + y});
  }
}

}  // namespace

ErasorTruth::Points ErasorTruth::around(const Tile& tile) const {
  Points points;
  for_each_neighbour(tile, [&](const Tile& neighbour) {
    const auto found = means_.find(neighbour);
    if (found == means_.end()) return;
    const Points& there = found->second;
    for (std::size_t i = 0; i < there.positions.size(); ++i) {
      if (!is_near(tile, there.positions[i])) continue;
      points.positions.push_back(there.positions[i]);
      points.kinds.push_back(there.kinds[i]);
    }
  });
  return points;
}

void ErasorTruth::score_tile(const Tile& tile, const MeansByTile& map,
                             const std::array<std::uint8_t, 256>& is_dynamic,
                             ErasorScores& scores) const {
  std::vector<Eigen::Vector3f> map_means;
  for_each_neighbour(tile, [&](const Tile& neighbour) {
    const auto found = map.find(neighbour);
    if (found == map.end()) return;
    for (const Eigen::Vector3f& p : found->second) {
      if (is_near(tile, p)) map_means.push_back(p);
    }
  });
  const Points scan_means = around(tile);
  const PointCells scans(scan_means.positions, kVoxelM);
  const Points truth = voxel_means(scans, scan_means.kinds);
  const PointCells map_cells(map_means, kVoxelM);
  for (std::size_t i = 0; i < truth.positions.size(); ++i) {
    if (tile_of(truth.positions[i]) != tile) continue;
    const bool dynamic = is_dynamic[truth.kinds[i]] != 0;
    ++(dynamic ? scores.truth_dynamic : scores.truth_static);
    const auto nearest = map_cells.nearest(truth.positions[i], kInlierM);
    if (!nearest || !(std::sqrt(nearest->squared_distance_m2) < kInlierM)) continue;
    // The truth voxel's own points are within 2 kInlierM of the map voxel, so one is found.
    const auto label = scans.nearest(map_means[nearest->point], 2.0 * kInlierM);
    if (!label || (is_dynamic[scan_means.kinds[label->point]] != 0) != dynamic) continue;
    ++(dynamic ? scores.dynamic_kept : scores.static_kept);
  }
}

ErasorScores ErasorTruth::scores(const std::vector<Eigen::Vector3f>& map_means,
                                 const std::array<std::uint8_t, 256>& is_dynamic) const {
  MeansByTile map;
  for (const Eigen::Vector3f& p : map_means) map[tile_of(p)].push_back(p);
  ErasorScores scores;
  for (const auto& [tile, points] : means_) score_tile(tile, map, is_dynamic, scores);
  scores.PR = share_of(scores.static_kept, scores.truth_static);
  scores.RR = 1.0 - share_of(scores.dynamic_kept, scores.truth_dynamic);
  scores.F1 = harmonic_mean(scores.PR, scores.RR);
  return scores;
}

PublishedMetrics::PublishedMetrics(std::vector<Eigen::Vector3f> map_points)
    : map_(std::move(map_points), kMapCellM),
      map_means_(erasor_voxel_means(map_.in_cell_order())) {}

void PublishedMetrics::add_scan(const TruthScan& scan) {
  if (scan.positions.size() != scan.is_dynamic.size()) {
    throw std::invalid_argument("is_dynamic: " + std::to_string(scan.is_dynamic.size()) +
                                " flags for " + std::to_string(scan.positions.size()) + " points");
  }
  truth_.add_scan(scan.sensor, scan.positions, scan.is_dynamic);
  count(scan);
}

void PublishedMetrics::count(const TruthScan& scan) {
  using Range = tbb::blocked_range<std::size_t>;
  const BenchmarkCounts added = tbb::parallel_reduce(
      Range(0, scan.positions.size(), 1024), BenchmarkCounts{},
      [&](const Range& range, BenchmarkCounts counts) {
        for (std::size_t i = range.begin(); i < range.end(); ++i) {
          const Eigen::Vector3f& p = scan.positions[i];
          if (!((p - scan.sensor).norm() < static_cast<float>(kTruthRangeM))) continue;
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
      [](const BenchmarkCounts& a, const BenchmarkCounts& b) {
        return BenchmarkCounts{a.truth_static + b.truth_static, a.truth_dynamic + b.truth_dynamic,
                               a.static_kept + b.static_kept,
                               a.dynamic_removed + b.dynamic_removed};
      });
  counts_.truth_static += added.truth_static;
  counts_.truth_dynamic += added.truth_dynamic;
  counts_.static_kept += added.static_kept;
  counts_.dynamic_removed += added.dynamic_removed;
}

BenchmarkScores PublishedMetrics::benchmark() const { return benchmark_scores(counts_); }

ErasorScores PublishedMetrics::erasor() const {
  // Kinds are the flags that were given.
  std::array<std::uint8_t, 256> is_dynamic{};
  is_dynamic.fill(1);
  is_dynamic[0] = 0;
  return truth_.scores(map_means_, is_dynamic);
}

}  // namespace stillmap::mapping
