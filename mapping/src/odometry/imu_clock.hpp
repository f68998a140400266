#pragma once

#include <stillmap/mapping/odometry.hpp>
#include <stillmap/mapping/progress.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/imu.hpp>

#include <Eigen/Core>

#include <cstdint>
#include <optional>
#include <span>
#include <string>
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
  /// Standard deviation of the clock offset [s]: large where the rate of turn hardly changes.
  double offset_sigma_s = 0.0;
  /// False if the best offset is at an end of the search: the true one may lie beyond.
  bool offset_is_inside = false;
  /// Median difference between the turns of scans and of the gyroscope, a step [rad].
  double off_rad = 0.0;
  /// Root mean square of the turns between two scans about their median [rad].
  double turn_rad = 0.0;
  /// Share of the squares of these turns that the gyroscope explains, in (-inf, 1]: 0 for one that
  /// always tells the same rate.
  double explained = 0.0;
};

/// Fewer turns between scans tell nothing.
inline constexpr std::size_t kLeastImuTurns = 20;
inline constexpr double kMostClockOffsetS = 0.5;

/// The clock offset and the bias with which the gyroscope's turns are nearest to those of the
/// scans: the offset is searched within `kMostClockOffsetS`, the bias is the median difference a
/// second.
/// @return nothing if readings cover fewer than `kLeastImuTurns` turns at any offset.
[[nodiscard]] std::optional<ImuCheck> fit_imu(std::span<const ScanTurn> turns,
                                              std::span<const maps::ImuReading> readings);

/// Why an IMU must not be used, for people: "it has no readings at the stamps of the scans".
/// @param turns, check  what `fit_imu` got and gave. @return empty if it may be used.
[[nodiscard]] std::string imu_fault(const maps::Imu& imu, std::span<const ScanTurn> turns,
                                    const std::optional<ImuCheck>& check);

/// The drive with its IMU fitted to 300 of its scans, as `default` odometry follows them: the first
/// ones in which the gyroscope turns at least half as much as anywhere in the drive; first without
/// the IMU, and where that does not fit, led by it. An IMU with an `imu_fault` is left out. The
/// drive's notes say what was found. A drive without an IMU, or with one that is fitted, stays as
/// it is.
/// @throws as `run_odometry`.
[[nodiscard]] maps::Drive with_fitted_imu(const maps::Drive& drive, int threads,
                                          const ProgressCallback& progress,
                                          const CancelFlag& cancel);

}  // namespace stillmap::mapping
