#include "odometry/direct/thinned_scan.hpp"

#include "odometry/hidden_scan.hpp"

#include <stillmap/localization/thinning.hpp>
#include <stillmap/maps/imu.hpp>

#include <algorithm>
#include <cstddef>
#include <vector>

namespace stillmap::mapping {
namespace {

/// Some 25,000 to 40,000 points of a scan of 64 rings: a cell of the map gets a shape from one or
/// two scans.
constexpr float kDenseCellM = 0.2F;
constexpr std::size_t kFewDense = 10'000;
constexpr float kSparseCellM = 0.5F;
constexpr std::size_t kFewSparse = 2000;
constexpr std::size_t kMostSparse = 4000;
/// Sparse sensors keep nearly all of their points.
constexpr float kLeastCellM = 0.05F;

/// One point a cell, of half the edge while that leaves only a few.
std::vector<std::size_t> thinned(const maps::PointCloud& cloud, float cell_m, std::size_t few) {
  std::vector<std::size_t> kept = localization::one_point_a_cell(cloud.positions, cell_m);
  while (kept.size() < few && cell_m > kLeastCellM && kept.size() < cloud.size()) {
    cell_m *= 0.5F;
    kept = localization::one_point_a_cell(cloud.positions, cell_m);
  }
  return kept;
}

void append(const maps::PointCloud& from, std::size_t point, maps::PointCloud& to) {
  to.positions.push_back(from.positions[point]);
  if (!from.time_offsets_s.empty()) to.time_offsets_s.push_back(from.time_offsets_s[point]);
}

}  // namespace

ThinnedScan thinned(const maps::Scan& scan) {
  ThinnedScan out;
  out.stamp_ns = scan.stamp_ns;
  out.source = scan.source;
  out.dense.turn = out.sparse.turn = scan.cloud.turn;
  for (const std::size_t i : thinned(scan.cloud, kDenseCellM, kFewDense))
    append(scan.cloud, i, out.dense);
  const std::vector<std::size_t> cells = thinned(out.dense, kSparseCellM, kFewSparse);
  const std::size_t count = std::min(cells.size(), kMostSparse);
  for (std::size_t i = 0; i < count; ++i)
    append(out.dense, cells[i * cells.size() / count], out.sparse);
  // Once, instead of each time that they are deskewed.
  maps::turn_to_stamp(out.dense);
  maps::turn_to_stamp(out.sparse);
  out.shell = is_shell(out.dense.positions);
  out.content = content_of(scan.cloud);
  return out;
}

}  // namespace stillmap::mapping
