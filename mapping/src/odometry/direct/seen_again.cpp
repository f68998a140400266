#include "odometry/direct/seen_again.hpp"

#include <stillmap/maps/cell_table.hpp>

#include <cstddef>
#include <cstdint>

namespace stillmap::mapping {
namespace {

constexpr double kSeenCellM = 1.0;
constexpr double kSeenNearM = 30.0;
constexpr std::size_t kMostRemembered = 600;
/// Fewer tell nothing.
constexpr std::size_t kFewestSeen = 50;

std::uint64_t seen_cell(const Eigen::Vector3d& p) {
  const Eigen::Vector3i c = (p / kSeenCellM).array().floor().cast<int>();
  return maps::signed_cell_key(c.x(), c.y(), c.z());
}

/// Whether a point lies in one of the cells or within half a cell of one.
bool is_near_seen(const maps::CellTable& cells, const Eigen::Vector3d& p) {
  for (unsigned corner = 0; corner < 8; ++corner) {
    const Eigen::Vector3d side((corner & 1U) != 0 ? 0.5 : -0.5, (corner & 2U) != 0 ? 0.5 : -0.5,
                               (corner & 4U) != 0 ? 0.5 : -0.5);
    if (cells.contains(seen_cell(p + kSeenCellM * side))) return true;
  }
  return false;
}

}  // namespace

void SeenAgain::remember(std::span<const Eigen::Vector3f> points_lidar,
                         const Eigen::Isometry3d& T_odom_lidar) {
  points_odom_.clear();
  const std::size_t stride = points_lidar.size() / kMostRemembered + 1;
  for (std::size_t i = 0; i < points_lidar.size(); i += stride)
    points_odom_.push_back(T_odom_lidar * points_lidar[i].cast<double>());
}

std::optional<double> SeenAgain::share(std::span<const Eigen::Vector3f> points_lidar,
                                       const Eigen::Isometry3d& T_odom_lidar) const {
  maps::CellTable cells(points_lidar.size() / 4);
  for (const Eigen::Vector3f& p : points_lidar) {
    if (p.squaredNorm() < 4.0 * kSeenNearM * kSeenNearM) cells.insert(seen_cell(p.cast<double>()));
  }
  const Eigen::Isometry3d T_lidar_odom = T_odom_lidar.inverse();
  std::size_t near = 0, again = 0;
  for (const Eigen::Vector3d& p_odom : points_odom_) {
    const Eigen::Vector3d p = T_lidar_odom * p_odom;
    if (p.squaredNorm() > kSeenNearM * kSeenNearM) continue;
    ++near;
    if (is_near_seen(cells, p)) ++again;
  }
  if (near < kFewestSeen) return std::nullopt;
  return static_cast<double>(again) / static_cast<double>(near);
}

}  // namespace stillmap::mapping
