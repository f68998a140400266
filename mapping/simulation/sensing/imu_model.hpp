#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include <Eigen/Geometry>

namespace stillmap::simulation {

/// An IMU fixed to the lidar: a Bosch BMI088 (data sheet BST-BMI088-DS001). Its walk is assumed, as
/// the data sheet does not tell it.
struct ImuModel {
  double rate_hz = 200.0;
  /// 0.014 deg/s/sqrt(Hz) [rad/s/sqrt(Hz)], and deviation of the offset of each axis: half of the
  /// 1 deg/s that the data sheet allows [rad/s].
  double gyro_noise = 2.4e-4;
  double gyro_offset_radps = 0.0087;
  /// 175 ug/sqrt(Hz) [m/s^2/sqrt(Hz)], and half of the 20 mg that the data sheet allows [m/s^2].
  double force_noise = 1.7e-3;
  double force_offset_mps2 = 0.1;
  /// 24 g, where readings end [m/s^2].
  double most_force_mps2 = 235.4;
  /// Walk of both offsets [rad/s^2/sqrt(Hz), m/s^3/sqrt(Hz)].
  double gyro_walk = 2e-5;
  double force_walk = 3e-4;
  /// Where it is in the lidar frame [m]; its axes are the lidar's.
  Eigen::Vector3d lever_m{-0.08, 0.05, -0.11};
  /// What its clock shows when the lidar's shows 0 [s]: readings are stamped late by so much.
  double clock_s = 0.037;
};

/// Readings of the whole drive as `imu.csv` has them: "stamp_ns,wx,wy,wz,ax,ay,az", rates [rad/s]
/// and specific force [m/s^2] in the lidar's axes.
/// @param T_world_lidar  true path. @param end_s  of the last sweep; the first starts at -0.05 s.
/// @param stamp_ns       the layout's clock. @param key  of the errors.
[[nodiscard]] std::string imu_csv(const ImuModel& model,
                                  const std::function<Eigen::Isometry3d(double)>& T_world_lidar,
                                  const std::function<std::int64_t(double)>& stamp_ns, double end_s,
                                  std::uint64_t key);

}  // namespace stillmap::simulation
