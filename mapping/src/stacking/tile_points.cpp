#include "stacking/tile_points.hpp"

#include "stacking/normals.hpp"

#include <stillmap/maps/tile_steps.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace stillmap::mapping {
namespace {

std::uint8_t short_number(std::uint32_t object) {
  return object == 0 ? std::uint8_t{0} : static_cast<std::uint8_t>(1 + (object - 1) % 255);
}

maps::PointKind kind_of(const VoxelSum& sum) {
  if (sum.moved()) return maps::PointKind::kProjected;
  return is_ground(sum) ? maps::PointKind::kGround : maps::PointKind::kMeasured;
}

/// Rounding to a float must not carry a point over its tile's border.
Eigen::Vector3f in_tile(maps::TileId tile, const Eigen::Vector3d& p) {
  Eigen::Vector3f rounded = p.cast<float>();
  const std::array<std::int32_t, 2> number{tile.x, tile.y};
  for (Eigen::Index axis = 0; axis < 2; ++axis) {
    const double corner = maps::kTileSizeM * number.at(static_cast<std::size_t>(axis));
    const auto end = static_cast<float>(corner + maps::kTileSizeM);
    rounded[axis] = std::clamp(rounded[axis], static_cast<float>(corner),
                               std::nextafter(end, -std::numeric_limits<float>::infinity()));
  }
  return rounded;
}

/// A point in the steps of its tile, still in its voxel.
Eigen::Vector3f in_package_steps(const VoxelGrid& grid, maps::TileId tile, std::uint64_t voxel,
                                 const Eigen::Vector3d& p) {
  const Eigen::Vector3d corner = corner_of(tile);
  const Eigen::Vector3d begin = grid.position(tile, voxel, Eigen::Vector3d::Zero()) - corner;
  return maps::in_steps_of_voxel(p - corner, begin, grid.voxel_size_m());
}

maps::MapPoint point_of(const Eigen::Vector3f& p, const VoxelSum& sum) {
  constexpr std::uint32_t kMostCounted = std::numeric_limits<std::uint16_t>::max();
  return {p.x(),
          p.y(),
          p.z(),
          maps::in_intensity_steps(sum.intensity / static_cast<float>(sum.observations)),
          static_cast<std::uint16_t>(std::min(sum.observations, kMostCounted)),
          kind_of(sum),
          short_number(sum.object)};
}

/// Normals of the measured points go into their history.
void set_normals(const std::vector<Eigen::Vector3f>& measured,
                 const std::vector<Eigen::Vector3f>& seen_from,
                 const std::vector<std::size_t>& numbers, TilePoints& tile) {
  const std::vector<SurfaceNormal> normals = estimate_normals(measured, seen_from);
  for (std::size_t i = 0; i < normals.size(); ++i) {
    maps::PointHistory& history = tile.history[numbers[i]];
    for (Eigen::Index axis = 0; axis < 3; ++axis)
      history.normal[axis] =
          static_cast<std::int8_t>(std::lround(127.0F * normals[i].normal[axis]));
    history.planarity = normals[i].planarity;
  }
}

}  // namespace

maps::MapTile TilePoints::placed(const Eigen::Vector3d& origin) const {
  return {origin, corner_of(id), points};
}

Eigen::Vector3d mean_of(const VoxelGrid& grid, maps::TileId tile, const VoxelSum& sum) {
  const Eigen::Vector3d offset =
      Eigen::Vector3f(sum.offset[0], sum.offset[1], sum.offset[2]).cast<double>() /
      sum.observations;
  return grid.position(tile, sum.voxel(), offset);
}

CleaningPoints cleaning_points(const VoxelGrid& grid, maps::TileId tile,
                               const std::vector<VoxelSum>& sums,
                               std::vector<std::size_t>& numbers) {
  CleaningPoints points;
  points.voxel_size_m = grid.voxel_size_m();
  numbers.clear();
  for (std::size_t i = 0; i < sums.size(); ++i) {
    if (sums[i].moved()) continue;
    points.positions.push_back(in_tile(tile, mean_of(grid, tile, sums[i])));
    points.is_ground.push_back(is_ground(sums[i]) ? 1 : 0);
    points.scans.push_back(sums[i].scans);
    numbers.push_back(i);
  }
  return points;
}

TilePoints to_points(const VoxelGrid& grid, maps::TileId tile, const std::vector<VoxelSum>& sums,
                     const std::function<Eigen::Vector3f(std::uint32_t scan)>& lidar_of_scan) {
  TilePoints out{tile, {}, {}};
  out.points.reserve(sums.size());
  out.history.reserve(sums.size());
  std::vector<Eigen::Vector3f> measured, seen_from;
  std::vector<std::size_t> numbers;
  for (const VoxelSum& sum : sums) {
    const Eigen::Vector3d p = mean_of(grid, tile, sum);
    if (!sum.moved()) {
      measured.push_back(in_tile(tile, p));
      seen_from.push_back(lidar_of_scan(sum.first_scan));
      numbers.push_back(out.points.size());
    }
    out.points.push_back(point_of(in_package_steps(grid, tile, sum.voxel(), p), sum));
    out.history.push_back({sum.first_scan, sum.last_scan, sum.object, {0, 0, 0}, 0});
  }
  set_normals(measured, seen_from, numbers, out);
  return out;
}

void add_filled(const Eigen::Vector3d& filled, std::uint32_t object, TilePoints& tile) {
  const Eigen::Vector3f p = maps::in_steps(filled - corner_of(tile.id));
  tile.points.push_back(
      {p.x(), p.y(), p.z(), 0.0F, 0, maps::PointKind::kFilled, short_number(object)});
  tile.history.push_back({0, 0, object, {0, 0, 0}, 0});
}

}  // namespace stillmap::mapping
