#include "query.hpp"

#include "index/voxel_table.hpp"

#include <algorithm>
#include <cmath>

namespace stillmap::localization {
namespace {

/// Columns whose lowest point is taken as ground.
constexpr float kColumnM = 2.0F;
/// Above kerbs and the lower part of slopes within a column, below bonnets, fences and low walls.
constexpr float kStandsAboveM = 0.6F;

std::int32_t cell_of(float coordinate_m, float edge_m) {
  return thin_detail::cell_of(coordinate_m, edge_m);
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

Query query_of(const ThinScan& scan, const Eigen::Matrix3d& R_map_lidar) {
  const maps::PointCloud& cloud = scan.points_lidar;
  const auto matched = static_cast<std::ptrdiff_t>(scan.matched);
  Query query;
  query.stands = standing_flags(cloud.positions, R_map_lidar.cast<float>());
  query.stands.resize(scan.matched);
  query.points.assign(cloud.positions.begin(), cloud.positions.begin() + matched);
  if (!cloud.time_offsets_s.empty())
    query.time_offsets_s.assign(cloud.time_offsets_s.begin(),
                                cloud.time_offsets_s.begin() + matched);
  for (std::size_t i = 0; i < scan.matched; ++i)
    if (query.stands[i] != 0) query.standing.push_back(i);
  return query;
}

}  // namespace stillmap::localization
