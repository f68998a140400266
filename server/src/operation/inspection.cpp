#include "operation/inspection.hpp"

#include <stillmap/maps/imu.hpp>
#include <stillmap/maps/pose_file.hpp>
#include <stillmap/maps/scan_file.hpp>
#include <stillmap/maps/sensor_preset.hpp>
#include <stillmap/maps/trajectory.hpp>

#include <fmt/format.h>
#include <fmt/ranges.h>

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

/// Of a recording; what `?sensor=` put behind it is left out.
std::string topic_of(const maps::Drive::Contents& contents) {
  using enum maps::DriveLayout;
  if (contents.layout != kMcap && contents.layout != kRosbag2 && contents.layout != kRosbag1 &&
      contents.layout != kPcap && contents.layout != kRawlog)
    return {};
  if (!contents.lidars.empty()) return fmt::format("{}", fmt::join(contents.lidars, ","));
  std::string topic = contents.entries.topic;
  for (const maps::SensorPreset& sensor : maps::sensor_presets()) {
    const std::string suffix = " " + std::string(sensor.name);
    if (topic.ends_with(suffix)) topic.resize(topic.size() - suffix.size());
  }
  return topic;
}

/// Floats are 16 mm coarse from here on.
constexpr double kTooCoarseFromM = 131072.0;
constexpr double kLargestMapM = 200'000.0;

void find_faults(std::uint64_t points, CloudFileSummary& summary) {
  if (points == 0) {
    summary.findings.push_back({"no_points", "no point that is finite", "another file"});
    return;
  }
  const double farthest_m = std::max(summary.bounds.min().cwiseAbs().maxCoeff(),
                                     summary.bounds.max().cwiseAbs().maxCoeff());
  if (summary.cloud.single_precision && farthest_m >= kTooCoarseFromM)
    summary.findings.push_back({"coarse_floats",
                                "coordinates of 131 km and more in 32-bit floats, which are 16 mm "
                                "coarse there and worse",
                                "write doubles, or coordinates from an origin nearby; these digits "
                                "are lost"});
  if (summary.bounds.sizes().maxCoeff() > kLargestMapM)
    summary.findings.push_back({"millimetres", "points over more than 200 km",
                                "metres: these look like millimetres, or some points lie at zero"});
  if (summary.intensities[0] == summary.intensities[1])
    summary.findings.push_back({"intensity_constant",
                                "all intensities are equal, or there are none",
                                "map their field to `intensity`, if there is one"});
}

}  // namespace

bool is_map_package(const std::filesystem::path& folder) {
  return std::filesystem::is_regular_file(folder / "manifest.json");
}

MapSummary summarize(const maps::MapPackage& package) {
  MapSummary summary;
  summary.digest = package.digest();
  summary.manifest = package.manifest();
  const maps::MapExtent& extent = summary.manifest.extent;
  summary.points = extent.points;
  summary.bounds_map = extent.from_origin.translated(summary.manifest.origin);
  summary.objects = package.objects().size();
  for (const maps::Trajectory& drive : package.trajectories()) {
    std::vector<Eigen::Isometry3d> path;
    for (const maps::StampedPose& pose : drive.poses()) path.push_back(pose.T_map_lidar);
    summary.poses += path.size();
    summary.path_length_m += path_length_m(path);
  }
  const auto disagreements = maps::read_pose_disagreements(package);
  if (!disagreements.empty()) summary.bent = maps::bent_places(disagreements);
  return summary;
}

namespace {

std::optional<ImuSummary> imu_summary(const maps::Drive::Contents& contents) {
  if (!contents.imu) return std::nullopt;
  const maps::Imu& imu = *contents.imu;
  return ImuSummary{
      imu.source,
      imu.readings->size(),
      imu.rate_hz(),
      imu.longest_gap_s(),
      maps::seconds_between(contents.stamps_ns.front(), imu.readings->front().stamp_ns),
      maps::seconds_between(contents.stamps_ns.back(), imu.readings->back().stamp_ns)};
}

}  // namespace

DriveSummary summarize_unread(const maps::Drive& drive) {
  const maps::Drive::Contents& contents = drive.contents();
  DriveSummary summary;
  summary.layout = contents.layout;
  summary.scans = drive.size();
  summary.relative_clock = contents.relative_clock;
  summary.has_poses = drive.has_poses();
  summary.has_labels = !contents.label_files.empty();
  summary.topic = topic_of(contents);
  summary.frame_id = contents.entries.frame_id;
  summary.fields = contents.entries.fields;
  summary.path_length_m = path_length_m(contents.T_map_lidar);
  summary.origin = contents.origin;
  summary.notes = contents.notes;
  if (drive.size() == 0) return summary;
  summary.duration_s =
      1e-9 * static_cast<double>(contents.stamps_ns.back() - contents.stamps_ns.front());
  if (summary.duration_s > 0.0) {
    summary.rate_hz = static_cast<double>(drive.size() - 1) / summary.duration_s;
  }
  summary.imu = imu_summary(contents);
  return summary;
}

DriveSummary summarize(const maps::Drive& drive) {
  DriveSummary summary = summarize_unread(drive);
  if (drive.size() == 0) return summary;
  const maps::Scan first = drive.read(0);
  summary.first_scan_points = first.cloud.size();
  // All zero where a scan counts as taken at once.
  summary.has_point_times =
      std::any_of(first.cloud.time_offsets_s.begin(), first.cloud.time_offsets_s.end(),
                  [](float time_s) { return time_s != 0.0F; });
  summary.first_scan_dropped = first.dropped;
  // The angles of several lidars together fit none.
  if (drive.contents().lidars.empty()) summary.sensors = maps::guess_sensors(first);
  for (const Eigen::Vector3f& p : first.cloud.positions)
    summary.first_scan_bounds.extend(p.cast<double>());
  summary.check = maps::check_drive(drive);
  return summary;
}

CloudFileSummary summarize_cloud(const std::filesystem::path& file) {
  CloudFileSummary summary;
  const std::string extension = file.extension().string();
  summary.format = extension.substr(std::min<std::size_t>(1, extension.size()));
  summary.bytes = std::filesystem::file_size(file);
  std::uint64_t points = 0;
  const auto take = [&](const Eigen::Vector3d& p, float intensity) {
    summary.bounds.extend(p);
    auto& [low, high] = summary.intensities;
    low = points == 0 ? intensity : std::min(low, intensity);
    high = points == 0 ? intensity : std::max(high, intensity);
    ++points;
  };
  if (summary.format == "bin") {
    const maps::DecodedScan scan = maps::read_scan_file(file);
    summary.cloud.points_in_file = scan.points_in_file;
    summary.cloud.non_finite = scan.dropped.non_finite;
    summary.cloud.fields = {"x", "y", "z", "intensity"};
    summary.cloud.single_precision = true;
    for (std::size_t i = 0; i < scan.cloud.size(); ++i)
      take(scan.cloud.positions[i].cast<double>(), scan.cloud.intensities[i]);
  } else {
    summary.cloud = maps::read_cloud_file(file, [&](std::span<const maps::CloudPoint> some) {
      for (const maps::CloudPoint& point : some) take(point.position, point.intensity);
    });
  }
  find_faults(points, summary);
  return summary;
}

TrajectorySummary summarize_trajectory(const std::filesystem::path& file) {
  TrajectorySummary summary;
  const maps::PoseFile read = maps::read_pose_file(file);
  summary.format = read.format;
  const std::vector<Eigen::Isometry3d> poses = read.all();
  if (read.has_stamps())
    summary.duration_s = 1e-9 * static_cast<double>(read.stamped.poses().back().stamp_ns -
                                                    read.stamped.poses().front().stamp_ns);
  summary.poses = poses.size();
  summary.path_length_m = path_length_m(poses);
  for (const Eigen::Isometry3d& pose : poses) summary.bounds.extend(pose.translation());
  return summary;
}

}  // namespace stillmap::server
