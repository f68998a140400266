#pragma once

#include <Eigen/Geometry>

#include <optional>
#include <string>

namespace stillmap::simulation {

// Size of KITTI's rectified images of 2011_09_26 [pixels].
inline constexpr double kImageWidth = 1242.0;
inline constexpr double kImageHeight = 375.0;

/// The camera of a simulated vehicle: the left colour one of KITTI (2011_09_26), which takes no
/// images here but gives label files their frame. It looks along the lidar's x axis, with x to the
/// right and y down, and its rectification does nothing.
struct KittiCamera {
  /// @param lidar_height_m  over ground; the camera stands 1.65 m over ground, as KITTI's does.
  explicit KittiCamera(double lidar_height_m);

  Eigen::Isometry3d T_cam_lidar;

  /// Pixel of a point in the camera frame; nothing closer than 0.1 m in front of it.
  [[nodiscard]] std::optional<Eigen::Vector2d> pixel_of(const Eigen::Vector3d& p_cam) const;

  /// `calib.txt` of the odometry benchmark: P0 to P3 and Tr.
  [[nodiscard]] std::string odometry_calibration() const;
  /// `calib.txt` of the tracking benchmark: P0 to P3, R0_rect and Tr_velo_to_cam.
  [[nodiscard]] std::string tracking_calibration() const;
  /// `calib_velo_to_cam.txt` and `calib_cam_to_cam.txt` of the raw data.
  [[nodiscard]] std::string velo_to_cam() const;
  [[nodiscard]] std::string cam_to_cam() const;
};

/// `calib_imu_to_velo.txt`.
[[nodiscard]] std::string imu_to_velo(const Eigen::Isometry3d& T_lidar_imu);

}  // namespace stillmap::simulation
