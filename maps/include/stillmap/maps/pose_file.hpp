#pragma once

#include <stillmap/maps/trajectory.hpp>

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

namespace stillmap::maps {

/// Poses as a file tells them: with stamps, by the numbers of scans, or one for each scan in turn.
struct PoseFile {
  /// "tum", "kitti", "kitti360", "csv", "g2o", "hdl_graph_slam" or "glim".
  std::string format;
  /// Of poses with stamps; the two below are empty then.
  Trajectory stamped;
  std::vector<Eigen::Isometry3d> poses;
  /// Of the scan that each pose belongs to; empty if the poses stand in the order of the scans.
  std::vector<std::size_t> numbers;

  [[nodiscard]] bool has_stamps() const { return !stamped.empty(); }
  /// In the order of the file.
  [[nodiscard]] std::vector<Eigen::Isometry3d> all() const;
};

/// Reads a file of poses, whose kind is told by its content. Positions in metres, at most 1e9;
/// rotations within 1e-3 of such ones. Cells are parted by blanks, tabs, commas or semicolons;
/// lines may end in CR LF, and the file may begin with a byte order mark. `#` begins a comment.
///
/// - 8 numbers: TUM, stamp tx ty tz qx qy qz qw.
/// - 12 or 16 numbers: KITTI, a matrix [R t] row by row, a line for each scan.
/// - 13 or 17 numbers: the same behind the number of the scan (KITTI-360), or behind a stamp of at
///   least 1e8.
/// - a header that names columns (CSV): x y z in metres with qx qy qz qw, or with roll pitch yaw in
///   radians, or `yaw_deg`, and a stamp or the number of the scan. Also in names as `position.x`
///   and `orientation.w`. A name alone goes before one with a prefix, as `std_roll`. The header may
///   be a comment. Units other than these, and two columns for one value, are errors.
/// - g2o: the vertices VERTEX_SE3:QUAT, whose ids number the scans.
/// - a folder that hdl_graph_slam or GLIM dumped.
///
/// Stamps are seconds, unless the header says otherwise (`timestamp_ns`) or the first is so large
/// that it counts milli-, micro- or nanoseconds since 1970; they increase.
/// @throws InputError naming file, line and value; StorageError.
[[nodiscard]] PoseFile read_pose_file(const std::filesystem::path& file);

}  // namespace stillmap::maps
