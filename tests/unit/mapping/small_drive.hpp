#pragma once

#include <fmt/format.h>
#include <stillmap/maps/box.hpp>

#include <Eigen/Geometry>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <string>
#include <vector>

#include "support/synthetic_world.hpp"
#include "support/temporary_folder.hpp"

/// Drives of a few scans on disk: a folder of `.bin` files with poses.txt.
namespace stillmap::test {

inline std::string bin_of(const maps::PointCloud& cloud, float intensity = 1.0F) {
  std::string bytes(cloud.size() * 16, '\0');
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Eigen::Vector3f& p = cloud.positions[i];
    const float row[4] = {p.x(), p.y(), p.z(), intensity};
    std::memcpy(bytes.data() + 16 * i, row, 16);
  }
  return bytes;
}

inline std::string kitti_line(const Eigen::Isometry3d& T) {
  std::string line;
  for (Eigen::Index row = 0; row < 3; ++row) {
    for (Eigen::Index column = 0; column < 4; ++column)
      line += fmt::format("{} ", T.matrix()(row, column));
  }
  line.back() = '\n';
  return line;
}

/// A car, its body 0.2 m over flat ground, between two walls, seen from a sensor that drives by
/// along x.
struct SmallDrive {
  static constexpr std::size_t kScans = 4;

  SmallDrive() {
    world.boxes = {{{8.0, 3.0, 0.2}, {12.3, 4.8, 1.5}},
                   {{-30.0, 8.0, 0.0}, {40.0, 8.5, 5.0}},
                   {{-30.0, -8.5, 0.0}, {40.0, -8.0, 5.0}}};
    pattern.rings = 32;
    pattern.columns = 360;
    for (std::size_t i = 0; i < kScans; ++i)
      T_map_lidar.push_back(pose_at(static_cast<double>(i), 0.0, 0.02 * static_cast<double>(i)));
  }

  [[nodiscard]] maps::PointCloud scan(std::size_t index) const {
    return world.scan(T_map_lidar[index], pattern);
  }

  /// The car as it lies in a scan's lidar frame.
  [[nodiscard]] maps::Box car_in(std::size_t index) const {
    maps::Box box;
    box.centre = T_map_lidar[index].inverse() * Eigen::Vector3d(10.15, 3.9, 0.75);
    box.size_m = {4.3, 1.8, 1.5};
    box.yaw_rad = -0.02 * static_cast<double>(index);
    box.object_class = maps::ObjectClass::kCar;
    return box;
  }

  /// @return the drive's folder.
  std::filesystem::path write(const TemporaryFolder& folder) const {
    std::string poses;
    for (std::size_t i = 0; i < kScans; ++i) {
      maps::PointCloud cloud = scan(i);
      for (Eigen::Vector3f& p : cloud.positions) p = R_old_new.transpose().cast<float>() * p;
      folder.write(fmt::format("drive/{:06}.bin", i), bin_of(cloud));
      poses += kitti_line(T_map_lidar[i] * Eigen::Isometry3d(Eigen::AngleAxisd(R_old_new)));
    }
    folder.write("drive/poses.txt", poses);
    return folder.path() / "drive";
  }

  /// @return a boxes file with the car in every scan.
  [[nodiscard]] std::filesystem::path write_car(const TemporaryFolder& folder) const {
    maps::BoxSequence boxes;
    for (std::size_t i = 0; i < kScans; ++i) {
      maps::Box box = car_in(i);
      const Eigen::Matrix3d R_new_old = R_old_new.transpose();
      const Eigen::Vector3d heading =
          R_new_old * Eigen::Vector3d(std::cos(box.yaw_rad), std::sin(box.yaw_rad), 0.0);
      box.centre = R_new_old * box.centre;
      if (!R_new_old.isIdentity(0.0)) box.yaw_rad = std::atan2(heading.y(), heading.x());
      boxes.by_scan[i] = {box};
    }
    const std::filesystem::path file = folder.path() / "boxes.json";
    maps::write_boxes(file, boxes);
    return file;
  }

  SyntheticWorld world;
  ScanPattern pattern;
  std::vector<Eigen::Isometry3d> T_map_lidar;
  /// How the sensor that writes the files is mounted against that of `T_map_lidar`.
  Eigen::Matrix3d R_old_new = Eigen::Matrix3d::Identity();
};

}  // namespace stillmap::test
