#pragma once

#include <stillmap/maps/drive.hpp>

#include <Eigen/Geometry>

#include <optional>
#include <string_view>
#include <vector>

namespace stillmap::maps {

/// The frame of the points in a drive's files: that of the sensor, as each scan was taken, or that
/// of the poses, as SLAM writes registered clouds.
enum class PointsFrame { kSensor, kMap };

/// "sensor" or "map"; nothing for another word.
[[nodiscard]] std::optional<PointsFrame> parse_points_frame(std::string_view word);

/// How well scans overlap that lie apart by the poses, read in both ways; in [0, 1].
struct PointsFrameOverlap {
  double as_sensor = 0.0;
  double as_map = 0.0;
  /// Without a motion.
  double without = 0.0;

  /// The frame in which the scans overlap better by 0.1; nothing where neither is.
  [[nodiscard]] std::optional<PointsFrame> frame() const;
};

/// Compares up to ten pairs of scans that are 1 m or 5 deg apart.
/// @param T_map_lidar  one a scan.
/// @param T_map_points  of points in the frame of a map, to that of the poses.
/// @return nothing where no scans lie apart. @throws as `Drive::read`.
[[nodiscard]] std::optional<PointsFrameOverlap> overlap_by_points_frame(
    const Drive::Contents& contents, const std::vector<Eigen::Isometry3d>& T_map_lidar,
    const Eigen::Isometry3d& T_map_points = Eigen::Isometry3d::Identity());

/// Points in the map's frame are read as points of the sensor: each scan goes back by its pose.
/// Points get no times: who registers scans has deskewed them.
/// @throws InputError without poses, or where the poses are so far from their origin that points in
/// 32-bit floats are coarse by 8 mm and more.
void read_points_from_map(Drive::Contents& contents,
                          const Eigen::Isometry3d& T_map_points = Eigen::Isometry3d::Identity());

}  // namespace stillmap::maps
