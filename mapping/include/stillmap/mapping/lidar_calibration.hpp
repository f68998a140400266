#pragma once

#include <stillmap/mapping/progress.hpp>
#include <stillmap/maps/drive.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// Where a lidar stands in the frame of another one, with what is known of each parameter.
struct LidarMount {
  Eigen::Isometry3d T_reference_lidar = Eigen::Isometry3d::Identity();
  /// Standard deviations of the place along x y z [m] and of the turn about x y z [rad], all along
  /// the axes of the reference. Large where nothing tells the parameter.
  Eigen::Matrix<double, 6, 1> sigma = Eigen::Matrix<double, 6, 1>::Zero();
  /// Motions or scans that it comes from.
  std::size_t used = 0;
};

struct LidarCalibration {
  /// By how both lidars moved.
  LidarMount from_motion;
  /// By the scans of each lidar in the map of the other one; nothing where these maps do not
  /// overlap.
  std::optional<LidarMount> from_maps;
  /// Share of a scan's points that lie on the other lidar's map, on the median; 0 without a scan.
  double overlap = 0.0;
  /// To be added to the lidar's stamps to get those of the reference's clock [s], and its
  /// deviation.
  double time_offset_s = 0.0;
  double time_offset_sigma_s = 0.0;
  /// Whether the mounts were found with the lidar's stamps shifted by it: it is far beyond its
  /// deviation.
  bool time_offset_used = false;

  [[nodiscard]] const LidarMount& mount() const { return from_maps ? *from_maps : from_motion; }
  /// "z", "roll" ... of `mount()`: what the drives do not tell (sigma beyond 0.1 m or 1 deg).
  [[nodiscard]] std::vector<std::string> unobserved() const;
};

/// Names of the six parameters in the order of `LidarMount::sigma`.
inline constexpr std::array<const char*, 6> kMountParameters{"x", "y", "z", "roll", "pitch", "yaw"};

struct LidarCalibrationTask {
  const maps::Drive& reference;
  /// Taken at the same time on the same vehicle. Poses of either are not used.
  const maps::Drive& lidar;
  /// 0 = all cores; the result is the same for any number.
  int threads = 0;
  /// May be empty; stages "odometry" and "match".
  ProgressCallback progress{};
};

/// Finds how one lidar of a vehicle stands to another one.
///
/// 1. Odometry follows each lidar alone.
/// 2. The clocks' offset, from the rates of turn, which are the same for both.
/// 3. Hand-eye calibration from the motions over 4 s.
/// 4. Scans of each lidar are aligned with the map that the other one made within the last seconds,
///    from the mount that the motions tell; all of them together give the mount.
///
/// The deviations are those that ten parts of the drive show among themselves, with half of what
/// the two directions of 4. differ by.
/// @throws maps::InputError for drives without a common time of 10 s, or whose motions do not tell
/// how one lidar is turned to the other; Cancelled.
[[nodiscard]] LidarCalibration calibrate_lidars(const LidarCalibrationTask& task,
                                                const CancelFlag& cancel);

}  // namespace stillmap::mapping
