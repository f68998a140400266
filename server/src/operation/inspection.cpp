#include "operation/inspection.hpp"

#include <algorithm>

namespace stillmap::server {
namespace {

double path_length_m(const std::vector<Eigen::Isometry3d>& T_map_lidar) {
  double length_m = 0.0;
  for (std::size_t i = 1; i < T_map_lidar.size(); ++i) {
    length_m += (T_map_lidar[i].translation() - T_map_lidar[i - 1].translation()).norm();
  }
  return length_m;
}

Eigen::Vector3d to_map(const std::array<float, 3>& p, const Eigen::Vector3d& origin) {
  return Eigen::Vector3d(p[0], p[1], p[2]) + origin;
}

}  // namespace

bool is_map_package(const std::filesystem::path& folder) {
  return std::filesystem::is_regular_file(folder / "manifest.json");
}

MapSummary summarize(const maps::MapPackage& package) {
  MapSummary summary;
  summary.digest = package.digest();
  summary.manifest = package.manifest();
  for (const maps::TileEntry& tile : summary.manifest.tiles) {
    if (tile.id.level != 0) continue;
    summary.points += tile.points;
    summary.bounds_map.extend(to_map(tile.min, summary.manifest.origin));
    summary.bounds_map.extend(to_map(tile.max, summary.manifest.origin));
  }
  summary.objects = package.objects().size();
  for (const maps::Trajectory& drive : package.trajectories()) {
    std::vector<Eigen::Isometry3d> path;
    for (const maps::StampedPose& pose : drive.poses()) path.push_back(pose.T_map_lidar);
    summary.poses += path.size();
    summary.path_length_m += path_length_m(path);
  }
  return summary;
}

DriveSummary summarize(const maps::Drive& drive) {
  const maps::Drive::Contents& contents = drive.contents();
  DriveSummary summary;
  summary.layout = contents.layout;
  summary.scans = drive.size();
  summary.relative_clock = contents.relative_clock;
  summary.has_poses = drive.has_poses();
  // {0, 0} stands for a scan that counts as taken at once.
  summary.has_point_times =
      std::any_of(contents.spin_start_end_s.begin(), contents.spin_start_end_s.end(),
                  [](const auto& spin) { return spin[0] != 0.0 || spin[1] != 0.0; });
  summary.has_labels = !contents.label_files.empty();
  summary.path_length_m = path_length_m(contents.T_map_lidar);
  summary.origin = contents.origin;
  summary.notes = contents.notes;
  if (drive.size() == 0) return summary;
  summary.duration_s =
      1e-9 * static_cast<double>(contents.stamps_ns.back() - contents.stamps_ns.front());
  if (summary.duration_s > 0.0) {
    summary.rate_hz = static_cast<double>(drive.size() - 1) / summary.duration_s;
  }
  const maps::Scan first = drive.read(0);
  summary.first_scan_points = first.cloud.size();
  summary.first_scan_dropped = first.dropped;
  for (const Eigen::Vector3f& p : first.cloud.positions)
    summary.first_scan_bounds.extend(p.cast<double>());
  summary.check = maps::check_drive(drive);
  return summary;
}

}  // namespace stillmap::server
