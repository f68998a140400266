#include "drives/points_frame.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <array>
#include <utility>

#include "drives/drive_sample.hpp"
#include "drives/layout.hpp"

namespace stillmap::maps {
namespace {

/// From there on floats are 8 mm coarse.
constexpr double kTooFarM = 65'536.0;

void move_points(const Eigen::Isometry3d& T, PointCloud& cloud) {
  // In doubles: what lies in a map may lie far from its origin.
  for (Eigen::Vector3f& p : cloud.positions) p = (T * p.cast<double>()).cast<float>();
}

PosedScan posed(const Eigen::Isometry3d& T_map_lidar, const PointCloud& cloud) {
  return {T_map_lidar, standing_points(cloud)};
}

}  // namespace

std::optional<PointsFrame> parse_points_frame(std::string_view word) {
  if (word == "sensor") return PointsFrame::kSensor;
  if (word == "map") return PointsFrame::kMap;
  return std::nullopt;
}

std::optional<PointsFrame> PointsFrameOverlap::frame() const {
  if (as_map > as_sensor + kClearlyBetter) return PointsFrame::kMap;
  if (as_sensor > as_map + kClearlyBetter) return PointsFrame::kSensor;
  return std::nullopt;
}

std::optional<PointsFrameOverlap> overlap_by_points_frame(
    const Drive::Contents& contents, const std::vector<Eigen::Isometry3d>& T_map_lidar,
    const Eigen::Isometry3d& T_map_points) {
  const Drive drive(contents);
  std::vector<std::array<PosedScan, 2>> of_sensor, of_map;
  for (const SamplePair& pair :
       choose_samples(drive.size(), [&](std::size_t i) { return std::optional(T_map_lidar[i]); })) {
    if (!pair.second) continue;
    of_sensor.emplace_back();
    of_map.emplace_back();
    const std::array scans{pair.first, *pair.second};
    for (std::size_t i = 0; i < scans.size(); ++i) {
      const Eigen::Isometry3d& T = T_map_lidar[scans[i]];
      PointCloud cloud = drive.read(scans[i]).cloud;
      of_sensor.back()[i] = posed(T, cloud);
      move_points(T.inverse() * T_map_points, cloud);
      of_map.back()[i] = posed(T, cloud);
    }
  }
  const auto sensor = compare_readings(of_sensor, 1);
  const auto map = compare_readings(of_map, 1);
  if (!sensor || !map) return std::nullopt;
  return PointsFrameOverlap{sensor->given, map->given, sensor->without};
}

void read_points_from_map(Drive::Contents& contents, const Eigen::Isometry3d& T_map_points) {
  if (contents.T_map_lidar.empty())
    throw InputError(contents.root.string(), "no poses for points in the frame of a map",
                     "the sensor's poses in that frame: give them with --poses FILE");
  double farthest_m = 0.0;
  for (const Eigen::Isometry3d& T : contents.T_map_lidar)
    farthest_m =
        std::max(farthest_m, (T_map_points.inverse() * T.translation()).cwiseAbs().maxCoeff());
  if (farthest_m >= kTooFarM)
    throw InputError(contents.root.string(),
                     fmt::format("points in the frame of a map {:.0f} m from its origin, where "
                                 "32-bit floats are coarse by 8 mm and more",
                                 farthest_m),
                     fmt::format("positions below {:.0f} m: take points and poses from an origin "
                                 "nearby, or give points in the sensor's frame",
                                 kTooFarM));
  set_entries_of_files(contents);
  Drive::Contents::Entries& entries = contents.entries;
  std::vector<Eigen::Isometry3d> T_lidar_points;
  for (std::size_t i = 0; i < entries.numbers.size(); ++i) {
    T_lidar_points.resize(std::max(T_lidar_points.size(), entries.numbers[i] + 1),
                          Eigen::Isometry3d::Identity());
    T_lidar_points[entries.numbers[i]] = contents.T_map_lidar[i].inverse() * T_map_points;
  }
  entries.read = [read = entries.read,
                  T_lidar_points = std::move(T_lidar_points)](std::size_t number) {
    DecodedScan scan = read(number);
    move_points(T_lidar_points.at(number), scan.cloud);
    scan.cloud.time_offsets_s.clear();
    return scan;
  };
  contents.spin_start_end_s.clear();
  contents.points_from_map = true;
}

}  // namespace stillmap::maps
