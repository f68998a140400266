#include "query.hpp"

#include "index/voxel_table.hpp"

#include <algorithm>
#include <cmath>

namespace stillmap::localization {
namespace {

constexpr float kCellM = 0.5F;
/// With fewer than these, in a room, cells of half the size are taken.
constexpr std::size_t kFewPoints = 1000;
/// Columns whose lowest point is taken as ground.
constexpr float kColumnM = 2.0F;
/// Above kerbs and the lower part of slopes within a column, below bonnets, fences and low walls.
constexpr float kStandsAboveM = 0.6F;

std::int32_t cell_of(float coordinate_m, float edge_m) {
  return static_cast<std::int32_t>(std::floor(coordinate_m / edge_m)) + kCellsPerAxis / 2;
}

}  // namespace

std::vector<char> standing_flags(const std::vector<Eigen::Vector3f>& points,
                                 const Eigen::Matrix3f& R) {
  std::vector<float> heights(points.size());
  std::vector<std::uint32_t> column_of(points.size());
  std::vector<float> lowest;
  VoxelTable columns(points.size() / 4);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3f p = R * points[i];
    const auto [column, inserted] =
        columns.insert(cell_key(cell_of(p.x(), kColumnM), cell_of(p.y(), kColumnM), 0));
    if (inserted) lowest.push_back(p.z());
    lowest[column] = std::min(lowest[column], p.z());
    heights[i] = p.z();
    column_of[i] = column;
  }
  std::vector<char> flags(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    flags[i] = heights[i] - lowest[column_of[i]] > kStandsAboveM ? 1 : 0;
  }
  return flags;
}

Query thin(const maps::PointCloud& scan_lidar, const Eigen::Matrix3d& R_map_lidar,
           double own_vehicle_m) {
  const auto thinned_to = [&](float cell_m) {
    return one_point_a_cell(scan_lidar.positions, cell_m, Lone::kLeftOut, own_vehicle_m);
  };
  std::vector<std::size_t> kept = thinned_to(kCellM);
  if (kept.size() < kFewPoints) kept = thinned_to(0.5F * kCellM);
  std::vector<Eigen::Vector3f> cells;
  for (const std::size_t i : kept) cells.push_back(scan_lidar.positions[i]);
  const std::vector<char> stands = standing_flags(cells, R_map_lidar.cast<float>());
  const std::size_t count = std::min(cells.size(), kMaxQueryPoints);
  Query query;
  query.points.reserve(count);
  query.stands.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t source = i * cells.size() / count;
    if (stands[source] != 0) query.standing.push_back(i);
    query.points.push_back(cells[source]);
    query.stands.push_back(stands[source]);
    if (!scan_lidar.time_offsets_s.empty())
      query.time_offsets_s.push_back(scan_lidar.time_offsets_s[kept[source]]);
  }
  return query;
}

}  // namespace stillmap::localization
