#pragma once

#include <stillmap/mapping/odometry.hpp>
#include <stillmap/mapping/progress.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/imu.hpp>

#include <Eigen/Core>

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// How the lidar turned between two scans, as their registration tells.
struct ScanTurn {
  std::int64_t from_ns = 0;
  std::int64_t to_ns = 0;
  Eigen::Matrix3d R_from_to = Eigen::Matrix3d::Identity();
};

/// What the turns of scans say about an IMU.
struct ImuCheck {
  maps::Imu::Fit fit;
  /// Median difference between the turns of scans and of the gyroscope, a step [rad].
  double off_rad = 0.0;
  /// Median turn between two scans [rad].
  double turn_rad = 0.0;
  std::size_t turns = 0;
};

/// The clock offset and the bias with which the gyroscope's turns are nearest to those of the
/// scans: the offset is searched within `kMostClockOffsetS`, the bias is the median difference a
/// second. Where the scans hardly turn, nothing tells the offset, and it is 0.
/// @return nothing if readings cover fewer than 20 turns at any offset.
[[nodiscard]] std::optional<ImuCheck> fit_imu(std::span<const ScanTurn> turns,
                                              std::span<const maps::ImuReading> readings);
inline constexpr double kMostClockOffsetS = 0.5;

/// The drive with its IMU fitted to its first scans, as `default` odometry follows them. An IMU
/// that does not fit is left out. The drive's notes say what was found. A drive without an IMU, or
/// with one that is fitted, stays as it is.
/// @throws as `run_odometry`.
[[nodiscard]] maps::Drive with_fitted_imu(const maps::Drive& drive, int threads,
                                          const ProgressCallback& progress,
                                          const CancelFlag& cancel);

}  // namespace stillmap::mapping
