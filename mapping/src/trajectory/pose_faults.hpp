#pragma once

#include "trajectory/path_difference.hpp"

#include <stillmap/maps/drive_check.hpp>

#include <Eigen/Geometry>

#include <array>
#include <functional>
#include <optional>
#include <vector>

namespace stillmap::mapping {

/// Faults of given poses that motion tells, each by what mends it; nothing where motion does not
/// tell, or tells that there is none.
struct PoseFaults {
  /// To be added to the stamps of the poses [s].
  std::optional<double> offset_s;
  /// The same of the first and the second half, where they differ.
  std::optional<std::array<double, 2>> offsets_of_halves_s;
  /// Axis of the scans that is turned round: 0 x, 1 y, 2 z.
  std::optional<int> mirrored_axis;
  /// Motion does not tell mirrored scans from poses of a frame whose z is down.
  bool may_be_z_down = false;
  /// Given lengths over true ones.
  std::optional<double> scale;
  /// Place of the lidar in the frame that the poses are of: what they are to be multiplied by from
  /// the right. Its translation is zero where that is not told, or too small.
  std::optional<Eigen::Isometry3d> T_given_lidar;
};

/// The ground as one scan sees it.
struct GroundSeen {
  /// Pose that was given for the scan.
  Eigen::Matrix3d R_map_given = Eigen::Matrix3d::Identity();
  /// Its normal, towards the sensor.
  Eigen::Vector3d up_lidar = Eigen::Vector3d::UnitZ();
};
/// Asked where motion alone leaves open whether axes are mirrored.
using SeeGround = std::function<std::optional<GroundSeen>()>;

/// Reports offsets over 0.05 s, scales off by over 1 %, rotations over 3 degrees and lever arms
/// over 0.5 m, each if over 5 standard deviations. @param see_ground  may be empty.
[[nodiscard]] PoseFaults pose_faults(const PathPair& paths, const SeeGround& see_ground);

/// How the poses were shifted in time before faults were looked for.
struct AppliedOffset {
  /// Added to their stamps [s].
  double seconds = 0.0;
  /// Whether the same option shifts the poses of other drives, too.
  bool several_drives = false;
};

/// In words, with their remedies. Codes: pose_clock, pose_clocks, mirrored_axis, pose_scale,
/// pose_frame.
[[nodiscard]] std::vector<maps::DriveFinding> findings_of(const PoseFaults& faults,
                                                          const AppliedOffset& applied = {});

}  // namespace stillmap::mapping
