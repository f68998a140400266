#include "odometry/direct/thinned_scan.hpp"

#include <stillmap/localization/thinning.hpp>

#include <algorithm>
#include <cstddef>
#include <vector>

namespace stillmap::mapping {
namespace {

/// Some 25,000 points of a scan of 64 rings: a cell of the map gets a shape from one or two scans.
constexpr float kDenseCellM = 0.2F;
constexpr float kSparseCellM = 0.5F;
constexpr std::size_t kMostSparse = 4000;

void append(const maps::PointCloud& from, std::size_t point, maps::PointCloud& to) {
  to.positions.push_back(from.positions[point]);
  if (!from.time_offsets_s.empty()) to.time_offsets_s.push_back(from.time_offsets_s[point]);
}

}  // namespace

ThinnedScan thinned(const maps::Scan& scan) {
  ThinnedScan out;
  out.stamp_ns = scan.stamp_ns;
  out.source = scan.source;
  for (const std::size_t i : localization::one_point_a_cell(scan.cloud.positions, kDenseCellM))
    append(scan.cloud, i, out.dense);
  const std::vector<std::size_t> cells =
      localization::one_point_a_cell(out.dense.positions, kSparseCellM);
  const std::size_t count = std::min(cells.size(), kMostSparse);
  for (std::size_t i = 0; i < count; ++i)
    append(out.dense, cells[i * cells.size() / count], out.sparse);
  return out;
}

}  // namespace stillmap::mapping
