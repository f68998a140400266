#include "query.hpp"

#include "voxel_table.hpp"

#include <algorithm>
#include <cmath>

namespace stillmap::localization {
namespace {

constexpr float kCellM = 0.5F;
constexpr float kMaxRangeM = 500.0F;
/// What is nearer is the vehicle itself, which no map holds: bonnet and tail of a car reach 2.5 m
/// from a sensor on its roof. Where much is that near, one is in a narrow place, and it counts.
constexpr float kOwnVehicleM = 2.7F;
constexpr float kMostOwnShare = 0.25F;
/// Columns whose lowest point is taken as ground.
constexpr float kColumnM = 2.0F;
/// Above kerbs and the lower part of slopes within a column, below bonnets, fences and low walls.
constexpr float kStandsAboveM = 0.6F;
/// Larger scans are strided down to this first; neighbours in the scan are closer than a cell
/// anyway.
constexpr std::size_t kMaxRead = 400'000;

std::int32_t cell_of(float coordinate_m, float edge_m) {
  return static_cast<std::int32_t>(std::floor(coordinate_m / edge_m)) + kCellsPerAxis / 2;
}

/// Range below which points are left out.
float nearest_range_m(const std::vector<Eigen::Vector3f>& positions) {
  const auto near = std::count_if(positions.begin(), positions.end(), [](const auto& p) {
    return p.squaredNorm() < kOwnVehicleM * kOwnVehicleM;
  });
  const float share = static_cast<float>(near) / static_cast<float>(positions.size() + 1);
  return share < kMostOwnShare ? kOwnVehicleM : 0.0F;
}

std::vector<Eigen::Vector3f> one_point_a_cell(const std::vector<Eigen::Vector3f>& positions) {
  const float nearest_m = nearest_range_m(positions);
  std::vector<Eigen::Vector3f> kept;
  VoxelTable cells(positions.size() / 8);
  const std::size_t step = positions.size() / kMaxRead + 1;
  for (std::size_t i = 0; i < positions.size(); i += step) {
    const Eigen::Vector3f& p = positions[i];
    const float range2 = p.squaredNorm();
    if (!(range2 < kMaxRangeM * kMaxRangeM) || range2 < nearest_m * nearest_m) continue;
    const std::uint64_t key =
        cell_key(cell_of(p.x(), kCellM), cell_of(p.y(), kCellM), cell_of(p.z(), kCellM));
    if (cells.insert(key).second) kept.push_back(p);
  }
  return kept;
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

Query thin(const maps::PointCloud& scan_lidar, const Eigen::Matrix3d& R_map_lidar) {
  const std::vector<Eigen::Vector3f> cells = one_point_a_cell(scan_lidar.positions);
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
  }
  return query;
}

}  // namespace stillmap::localization
