#include <stillmap/localization/thinning.hpp>

#include "index/voxel_table.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <utility>

namespace stillmap::localization {
namespace {

constexpr float kMaxRangeM = 500.0F;
/// Where more of a scan is as near as the vehicle itself, one is in a narrow place, and it counts.
constexpr float kMostOwnShare = 0.25F;
/// Larger scans are strided down to this first; neighbours in the scan are closer than a cell
/// anyway.
constexpr std::size_t kMaxRead = 400'000;

/// Range below which points are left out.
float nearest_range_m(std::span<const Eigen::Vector3f> positions, float own_vehicle_m) {
  const auto near = std::count_if(positions.begin(), positions.end(), [&](const auto& p) {
    return p.squaredNorm() < own_vehicle_m * own_vehicle_m;
  });
  const float share = static_cast<float>(near) / static_cast<float>(positions.size() + 1);
  return share < kMostOwnShare ? own_vehicle_m : 0.0F;
}

/// Lone points are looked for in cells whose edge is at least one of so many parts of the range: a
/// surface seen by a lidar of 0.7 degrees a column has two points or more in each.
constexpr float kEdgesPerRange = 32.0F;
/// They double with the range, up to so many edges of the first; what is farther is sparse anyway.
constexpr float kMostLoneEdges = 4.0F;
/// In sparse scans surfaces have lone points, too: of 2,000 to 5,000 points of a hand-held sensor a
/// fifth of the near cells.
constexpr std::size_t kSparsePoints = 10'000;
/// Where more of the points are lone, and more of those in a range, the scan was thinned before.
constexpr double kMostLoneShare = 0.15;
constexpr double kMostLoneShareOfRange = 0.35;

/// One point of each cell, and how many different points the cell has.
struct Cells {
  float edge_m;
  std::vector<std::size_t> points;
  std::vector<std::uint32_t> counts;
};

std::uint64_t key_of(const Eigen::Vector3f& p, float edge_m) {
  const auto cell_of = [&](float coordinate_m) {
    return static_cast<std::int32_t>(std::floor(coordinate_m / edge_m)) + kCellsPerAxis / 2;
  };
  return cell_key(cell_of(p.x()), cell_of(p.y()), cell_of(p.z()));
}

/// Numbers of the cells within a range whose point is the only one in a cell of the edge `edge_m`,
/// and the share of the points there that these are.
struct LoneCells {
  std::vector<std::size_t> cells;
  double share = 0.0;
};

LoneCells lone_cells(std::span<const Eigen::Vector3f> positions, const Cells& cells, float edge_m,
                     float from_m, float to_m) {
  constexpr float kDiagonal = 1.74F;
  const auto is_within = [&](std::size_t i, float near_m, float far_m) {
    const float range2 = positions[cells.points[i]].squaredNorm();
    return range2 >= near_m * near_m && range2 < far_m * far_m;
  };
  const auto key = [&](std::size_t i) { return key_of(positions[cells.points[i]], edge_m); };
  std::vector<std::size_t> single;
  std::size_t points = 0;
  for (std::size_t i = 0; i < cells.points.size(); ++i) {
    if (!is_within(i, from_m, to_m)) continue;
    points += cells.counts[i];
    if (cells.counts[i] == 1) single.push_back(i);
  }
  VoxelTable coarse(single.size());
  std::vector<std::uint32_t> counts;
  for (const std::size_t i : single)
    if (coarse.insert(key(i)).second) counts.push_back(0);
  const float margin_m = edge_m > cells.edge_m ? kDiagonal * edge_m : 0.0F;
  for (std::size_t i = 0; i < cells.points.size(); ++i) {
    if (!is_within(i, from_m - margin_m, to_m + margin_m)) continue;
    const std::uint32_t cell = coarse.find(key(i));
    if (cell != VoxelTable::kNone) counts[cell] += cells.counts[i];
  }
  std::erase_if(single, [&](std::size_t i) { return counts[coarse.find(key(i))] > 1; });
  const double share =
      static_cast<double>(single.size()) / std::max(1.0, static_cast<double>(points));
  return {std::move(single), share};
}

/// Leaves out the cells whose point is the only one around it, as rain, dust and crosstalk give
/// them.
void leave_out_lone(std::span<const Eigen::Vector3f> positions, Cells& cells) {
  std::vector<LoneCells> by_range;
  std::size_t found = 0;
  float from_m = 0.0F;
  for (float edge_m = cells.edge_m; edge_m <= kMostLoneEdges * cells.edge_m; edge_m *= 2.0F) {
    const float to_m = kEdgesPerRange * edge_m;
    by_range.push_back(lone_cells(positions, cells, edge_m, from_m, to_m));
    found += by_range.back().cells.size();
    from_m = to_m;
  }
  const auto all = std::accumulate(cells.counts.begin(), cells.counts.end(), std::size_t{0});
  const bool many = static_cast<double>(found) > kMostLoneShare * static_cast<double>(all);
  std::vector<char> lone(cells.points.size(), 0);
  for (const LoneCells& in_range : by_range) {
    if (many && in_range.share > kMostLoneShareOfRange) continue;
    for (const std::size_t i : in_range.cells) lone[i] = 1;
  }
  std::size_t kept = 0;
  for (std::size_t i = 0; i < cells.points.size(); ++i)
    if (lone[i] == 0) cells.points[kept++] = cells.points[i];
  cells.points.resize(kept);
}

}  // namespace

std::vector<std::size_t> one_point_a_cell(std::span<const Eigen::Vector3f> positions, float cell_m,
                                          Lone lone, double own_vehicle_m) {
  const float nearest_m = nearest_range_m(positions, static_cast<float>(own_vehicle_m));
  Cells cells{.edge_m = cell_m, .points = {}, .counts = {}};
  VoxelTable table(positions.size() / 8);
  const std::size_t step = positions.size() / kMaxRead + 1;
  for (std::size_t i = 0; i < positions.size(); i += step) {
    const Eigen::Vector3f& p = positions[i];
    const float range2 = p.squaredNorm();
    if (!(range2 < kMaxRangeM * kMaxRangeM) || range2 < nearest_m * nearest_m) continue;
    const auto [cell, inserted] = table.insert(key_of(p, cell_m));
    if (inserted) {
      cells.points.push_back(i);
      cells.counts.push_back(1);
    } else if (cells.counts[cell] > 1 || p != positions[cells.points[cell]]) {
      // A point that is sent twice is alone still.
      ++cells.counts[cell];
    }
  }
  if (lone == Lone::kLeftOut && positions.size() >= kSparsePoints) leave_out_lone(positions, cells);
  return std::move(cells.points);
}

}  // namespace stillmap::localization
