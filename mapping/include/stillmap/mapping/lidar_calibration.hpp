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
  /// Rows x y z [m], turns about x y z [rad]; all along the axes of the reference: the mount is off
  /// by a shift and by a turn on the left of its rotation. Large where nothing tells a parameter.
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
  /// Motions or scans that it comes from.
  std::size_t used = 0;

  /// x y z [m], roll pitch yaw [rad] as `maps::roll_pitch_yaw_rad`, and their standard deviations.
  [[nodiscard]] Eigen::Matrix<double, 6, 1> values() const;
  [[nodiscard]] Eigen::Matrix<double, 6, 1> sigma() const;
};

/// What is to be added to a lidar's stamps to get those of the reference's clock.
struct ClockOffset {
  double offset_s = 0.0;
  double sigma_s = 0.0;
  /// Whether the mounts were found with it: it is beyond three deviations.
  bool is_used = false;
};

struct LidarCalibration {
  /// By how both lidars moved.
  LidarMount from_motion;
  /// By the scans of each lidar in the map of the other one; nothing where these maps do not
  /// overlap.
  std::optional<LidarMount> from_maps;
  /// Share of a scan's points that lie on the other lidar's map, on the median; 0 without a scan.
  double overlap = 0.0;
  /// Nothing where the motions do not tell it. Its deviation enters those of the mounts, as a way
  /// at the usual speed.
  std::optional<ClockOffset> clock;

  [[nodiscard]] const LidarMount& mount() const { return from_maps ? *from_maps : from_motion; }
  /// "z", "roll" ... of `mount()`: what the drives do not tell (sigma beyond 0.1 m or 1 deg).
  [[nodiscard]] std::vector<std::string> unobserved() const;
};

/// Names of the six parameters in the order of `LidarMount::values`.
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
/// 2. The clocks' offset, from motions over a second (`path_difference`).
/// 3. Hand-eye calibration from the motions over 4 s.
/// 4. Scans of each lidar are aligned with the map that the other one made within the last seconds,
///    from the mount that the motions tell; all of them together give the mount.
///
/// The deviations are those that ten parts of the drive show among themselves, with half of what
/// the two directions of 4. differ by.
/// @throws maps::InputError for drives without a common time of 10 s, whose clocks differ by more
/// than 1 s, or whose motions do not tell how one lidar is turned to the other; Cancelled.
[[nodiscard]] LidarCalibration calibrate_lidars(const LidarCalibrationTask& task,
                                                const CancelFlag& cancel);

}  // namespace stillmap::mapping
