#include <stillmap/localization/thinning.hpp>

namespace stillmap::localization {
namespace {

void add_point(const ScanView& scan, std::size_t i, maps::PointCloud& to) {
  const auto [x, y, z] = scan.point(i);
  to.positions.emplace_back(x, y, z);
  if (scan.time_s != nullptr) to.time_offsets_s.push_back(scan.time(i));
}

void reserve(const ScanView& scan, std::size_t points, maps::PointCloud& cloud) {
  cloud.positions.reserve(points);
  if (scan.time_s != nullptr) cloud.time_offsets_s.reserve(points);
}

}  // namespace

ScanView view_of(std::span<const Eigen::Vector3f> positions) {
  return {.xyz = positions.data(),
          .xyz_stride_bytes = sizeof(Eigen::Vector3f),
          .size = positions.size()};
}

ScanView view_of(const maps::PointCloud& scan_lidar) {
  ScanView view = view_of(std::span(scan_lidar.positions));
  if (scan_lidar.time_offsets_s.empty()) return view;
  view.time_s = scan_lidar.time_offsets_s.data();
  view.time_stride_bytes = sizeof(float);
  return view;
}

ThinScan whole_scan(const ScanView& scan_lidar) {
  ThinScan whole;
  reserve(scan_lidar, scan_lidar.size, whole.points_lidar);
  for (std::size_t i = 0; i < scan_lidar.size; ++i)
    if (scan_lidar.is_point(i)) add_point(scan_lidar, i, whole.points_lidar);
  whole.matched = whole.points_lidar.size();
  return whole;
}

ThinScan picked(const ScanView& scan_lidar, const ThinPoints& thin) {
  ThinScan out;
  out.matched = thin.matched;
  reserve(scan_lidar, thin.indices.size(), out.points_lidar);
  for (const std::size_t i : thin.indices) add_point(scan_lidar, i, out.points_lidar);
  return out;
}

std::vector<std::size_t> one_point_a_cell(std::span<const Eigen::Vector3f> positions, float cell_m,
                                          Lone lone, double own_vehicle_m) {
  const ScanView view = view_of(positions);
  return one_point_a_cell(view, cell_m, lone, count_points(view, own_vehicle_m));
}

}  // namespace stillmap::localization
