#include "output/kitti_camera.hpp"

#include <fmt/format.h>

#include <array>

#include "output/file_output.hpp"

namespace stillmap::simulation {
namespace {

using Projection = Eigen::Matrix<double, 3, 4>;

constexpr double kCameraHeightM = 1.65;
constexpr double kNearestM = 0.1;

/// P_rect_00 to P_rect_03 of KITTI's 2011_09_26: one lens for all, and where each camera stands.
Projection projection_of(std::size_t camera) {
  constexpr std::array<std::array<double, 3>, 4> kOffsets{{{0.0, 0.0, 0.0},
                                                           {-387.5744, 0.0, 0.0},
                                                           {44.85728, 0.2163791, 0.002745884},
                                                           {-339.5242, 2.199936, 0.002729905}}};
  const std::array<double, 3>& offset = kOffsets.at(camera);
  Projection P;
  P << 721.5377, 0.0, 609.5593, offset[0], 0.0, 721.5377, 172.854, offset[1], 0.0, 0.0, 1.0,
      offset[2];
  return P;
}

template <typename Matrix>
std::string numbers_of(const Matrix& matrix) {
  std::string row;
  for (Eigen::Index r = 0; r < matrix.rows(); ++r) {
    for (Eigen::Index c = 0; c < matrix.cols(); ++c) row += fmt::format(" {:.12e}", matrix(r, c));
  }
  return row;
}

std::string projection_rows(const char* name) {
  std::string rows;
  for (std::size_t camera = 0; camera < 4; ++camera) {
    rows += fmt::format(fmt::runtime(name), camera) + numbers_of(projection_of(camera)) + "\n";
  }
  return rows;
}

std::string rigid_rows(const Eigen::Isometry3d& T) {
  const Eigen::Matrix3d R = T.linear();
  return "R:" + numbers_of(R) + "\nT:" + numbers_of(Eigen::RowVector3d(T.translation())) + "\n";
}

}  // namespace

KittiCamera::KittiCamera(double lidar_height_m) : T_cam_lidar(Eigen::Isometry3d::Identity()) {
  T_cam_lidar.linear() << 0.0, -1.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0;
  // KITTI's camera is 0.27 m in front of its lidar.
  T_cam_lidar.translation() = Eigen::Vector3d(0.0, kCameraHeightM - lidar_height_m, -0.27);
}

std::optional<Eigen::Vector2d> KittiCamera::pixel_of(const Eigen::Vector3d& p_cam) const {
  if (!(p_cam.z() >= kNearestM)) return std::nullopt;
  constexpr std::size_t kLeftColour = 2;
  const Eigen::Vector3d h = projection_of(kLeftColour) * p_cam.homogeneous();
  return Eigen::Vector2d(h.x() / h.z(), h.y() / h.z());
}

std::string KittiCamera::odometry_calibration() const {
  return projection_rows("P{}:") + "Tr: " + kitti_row_of(T_cam_lidar) + "\n";
}

std::string KittiCamera::tracking_calibration() const {
  return projection_rows("P{}:") + "R0_rect:" + numbers_of(Eigen::Matrix3d::Identity()) +
         "\nTr_velo_to_cam: " + kitti_row_of(T_cam_lidar) + "\n";
}

std::string KittiCamera::velo_to_cam() const { return rigid_rows(T_cam_lidar); }

std::string KittiCamera::cam_to_cam() const {
  std::string rows = projection_rows("P_rect_0{}:");
  for (std::size_t camera = 0; camera < 4; ++camera) {
    rows += fmt::format("S_rect_0{}: {:.6e} {:.6e}\n", camera, kImageWidth, kImageHeight);
    rows += fmt::format("R_rect_0{}:", camera) + numbers_of(Eigen::Matrix3d::Identity()) + "\n";
  }
  return rows;
}

std::string imu_to_velo(const Eigen::Isometry3d& T_lidar_imu) { return rigid_rows(T_lidar_imu); }

}  // namespace stillmap::simulation
