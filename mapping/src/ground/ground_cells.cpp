#include "ground/ground_cells.hpp"

#include "projection/box_columns.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

constexpr float kNearSigmaM = 0.02F;
constexpr float kSigmaPerMetre = 0.002F;
/// A layer of a cell is this thin [m]: slopes of 40 % fit in, the two sides of a kerb do not.
constexpr float kLayerM = 0.1F;
/// What boxes are grown by here [m]: an underside just outside of a box that is a little too small
/// must not become road.
constexpr double kBoxMarginM = 0.2;

struct LocalCellPoint {
  std::uint64_t key;
  float z;
  float offset_x;
  float offset_y;
  float weight;
  bool in_box;
};

/// Sorts by block first, so that `FusedGround::add` meets each block once.
std::uint64_t cell_key(int x, int y) {
  const auto ux = static_cast<std::uint64_t>(x + 2 * kMaxGroundCell);
  const auto uy = static_cast<std::uint64_t>(y + 2 * kMaxGroundCell);
  return (uy >> 4) << 30 | (ux >> 4) << 8 | (uy & 15U) << 4 | (ux & 15U);
}

int x_of(std::uint64_t key) {
  return static_cast<int>(((key >> 8) & 0x3FFFFFU) << 4 | (key & 15U)) - 2 * kMaxGroundCell;
}
int y_of(std::uint64_t key) {
  return static_cast<int>((key >> 30) << 4 | ((key >> 4) & 15U)) - 2 * kMaxGroundCell;
}

std::vector<LocalCellPoint> cell_points(const maps::PointCloud& cloud,
                                        const std::vector<std::uint8_t>& is_ground,
                                        std::span<const maps::Box> boxes,
                                        const Eigen::Isometry3d& T_local_lidar) {
  std::vector<MovableBox> movable;
  for (const maps::Box& box : boxes) movable.push_back({box, 0.0});
  ProjectionOptions grown;
  grown.margin_m = kBoxMarginM;
  const BoxColumns columns(movable, grown);
  std::vector<LocalCellPoint> points;
  const std::vector<Eigen::Vector3f>& positions = cloud.positions;
  points.reserve(positions.size() / 2);
  for (std::size_t i = 0; i < positions.size(); ++i) {
    if (is_ground[i] == 0) continue;
    const Eigen::Vector3d p = T_local_lidar * positions[i].cast<double>();
    const int x = ground_cell_of(p.x());
    const int y = ground_cell_of(p.y());
    if (std::abs(x) >= kMaxGroundCell || std::abs(y) >= kMaxGroundCell) continue;
    const float far2 = kSigmaPerMetre * kSigmaPerMetre * cloud.ray(i).squaredNorm();
    constexpr float kNear2 = kNearSigmaM * kNearSigmaM;
    points.push_back({cell_key(x, y), static_cast<float>(p.z()),
                      static_cast<float>(p.x() - ground_cell_centre(x)),
                      static_cast<float>(p.y() - ground_cell_centre(y)), kNear2 / (kNear2 + far2),
                      columns.first_with(positions[i]) >= 0});
  }
  // Offsets part equal heights, so that the sums below have one order.
  std::sort(points.begin(), points.end(), [](const LocalCellPoint& a, const LocalCellPoint& b) {
    if (a.key != b.key) return a.key < b.key;
    if (a.z != b.z) return a.z < b.z;
    if (a.offset_x != b.offset_x) return a.offset_x < b.offset_x;
    return a.offset_y < b.offset_y;
  });
  return points;
}

/// The mean of a layer. Points of one scan share the errors of its pose, so more of them add
/// ever less.
GroundCells::Cell mean_of(std::span<const LocalCellPoint> layer) {
  GroundCells::Cell cell;
  cell.x = x_of(layer.front().key);
  cell.y = y_of(layer.front().key);
  double sum = 0.0, z = 0.0, x = 0.0, y = 0.0;
  for (const LocalCellPoint& p : layer) {
    const auto w = static_cast<double>(p.weight);
    sum += w;
    z += w * static_cast<double>(p.z);
    x += w * static_cast<double>(p.offset_x);
    y += w * static_cast<double>(p.offset_y);
    cell.in_box |= p.in_box;
  }
  const auto count = static_cast<double>(layer.size());
  cell.z = static_cast<float>(z / sum);
  cell.offset_x = static_cast<float>(x / sum);
  cell.offset_y = static_cast<float>(y / sum);
  cell.weight = static_cast<float>(sum / count * (count / (count + 1.0)));
  return cell;
}

}  // namespace

GroundCells reduce_ground(const maps::PointCloud& cloud, const std::vector<std::uint8_t>& is_ground,
                          std::span<const maps::Box> boxes,
                          const Eigen::Isometry3d& T_local_lidar) {
  if (cloud.size() != is_ground.size()) {
    throw std::invalid_argument(
        fmt::format("ground flags: {}, expected one a point ({})", is_ground.size(), cloud.size()));
  }
  const std::vector<LocalCellPoint> points = cell_points(cloud, is_ground, boxes, T_local_lidar);
  GroundCells result;
  std::size_t first = 0;
  for (std::size_t i = 1; i <= points.size(); ++i) {
    const bool same = i < points.size() && points[i].key == points[first].key &&
                      points[i].z - points[first].z <= kLayerM;
    if (same) continue;
    result.cells.push_back(mean_of(std::span(points).subspan(first, i - first)));
    first = i;
  }
  return result;
}

}  // namespace stillmap::mapping
