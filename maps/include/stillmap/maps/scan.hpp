#pragma once

#include <Eigen/Core>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace stillmap::maps {

class SweepTurn;

/// Points of one frame, with the attributes that came with them.
struct PointCloud {
  /// N points [m], all finite once they have passed a reader.
  std::vector<Eigen::Vector3f> positions;
  /// N values in the sensor's own scale, or empty.
  std::vector<float> intensities;
  /// N times [s] relative to the scan's stamp, or empty when the layout does not tell. All zero:
  /// taken at one instant, or deskewed.
  std::vector<float> time_offsets_s;
  /// How the lidar turned during the sweep, where an IMU tells it; null elsewhere. `deskew` turns
  /// by it instead of by a constant rate.
  std::shared_ptr<const SweepTurn> turn;
  /// N positions in the file, ascending; empty when nothing of the file was left out.
  std::vector<std::uint32_t> file_indices;
  /// Of a drive with several lidars: N numbers in `lidar_origins`, of the lidar that took each
  /// point. Empty when one lidar took all points.
  std::vector<std::uint8_t> lidars;
  /// Where the lidars stand in the frame of the points [m]. Empty when one lidar took all points:
  /// it stands at the origin.
  std::vector<Eigen::Vector3f> lidar_origins;

  [[nodiscard]] std::size_t size() const { return positions.size(); }
  [[nodiscard]] bool empty() const { return positions.empty(); }
  /// Position of a point in the file.
  [[nodiscard]] std::size_t file_index(std::size_t point) const {
    return file_indices.empty() ? point : file_indices[point];
  }
  /// Where the lidar that took a point stands [m].
  [[nodiscard]] Eigen::Vector3f origin_of(std::size_t point) const {
    return lidars.empty() ? Eigen::Vector3f::Zero() : lidar_origins[lidars[point]];
  }
  /// From the lidar that took a point to the point [m].
  [[nodiscard]] Eigen::Vector3f ray(std::size_t point) const {
    return positions[point] - origin_of(point);
  }
  /// The points of one lidar, in their order, as if it had taken the scan alone: from where it
  /// stands, along the axes of the frame. @param lidar  below the number of `lidar_origins`.
  [[nodiscard]] PointCloud of_lidar(std::size_t lidar) const;
  /// Keeps the points with a flag, in their order. @param keep  N flags.
  void keep_only(const std::vector<std::uint8_t>& keep);
};

/// What a reader left out, and why.
struct DropCounts {
  std::size_t non_finite = 0;
  /// Closer than the sensor can see, i.e. exactly zero range: the mark of "no return".
  std::size_t zero_range = 0;
  /// Marked by the sensor itself as dust, rain, glare or a late echo.
  std::size_t unsure = 0;

  DropCounts& operator+=(const DropCounts& other) {
    non_finite += other.non_finite;
    zero_range += other.zero_range;
    unsure += other.unsure;
    return *this;
  }
};

/// One sweep of the sensor in its lidar frame.
struct Scan {
  /// Position in its drive, from 0.
  std::size_t index = 0;
  std::int64_t stamp_ns = 0;
  /// File it came from, for messages.
  std::string source;
  PointCloud cloud;
  DropCounts dropped;
  /// Points in the file, kept or dropped.
  std::size_t points_in_file = 0;
  /// As `DecodedScan::times_note`.
  std::string times_note;
};

}  // namespace stillmap::maps
