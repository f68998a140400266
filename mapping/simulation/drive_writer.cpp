#include "drive_writer.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <bit>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <span>
#include <string>
#include <string_view>

namespace stillmap::simulation {
namespace {

static_assert(std::endian::native == std::endian::little, "scans are little endian as they lie");

void write(const std::filesystem::path& file, std::span<const std::byte> bytes) {
  std::ofstream stream(file, std::ios::binary);
  stream.write(reinterpret_cast<const char*>(bytes.data()),
               static_cast<std::streamsize>(bytes.size()));
  stream.close();
  if (!stream) throw maps::StorageError(file.string(), std::strerror(errno));
}

void write(const std::filesystem::path& file, std::string_view text) {
  write(file, std::as_bytes(std::span(text)));
}

std::string row_of(const Eigen::Isometry3d& T) {
  std::string row;
  for (Eigen::Index r = 0; r < 3; ++r) {
    for (Eigen::Index c = 0; c < 4; ++c) {
      row += fmt::format("{}{:.12e}", row.empty() ? "" : " ", T(r, c));
    }
  }
  return row;
}

/// The camera looks along the lidar's x, with x to the right and y down, and sits where KITTI's
/// does.
Eigen::Isometry3d make_T_cam_lidar() {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() << 0.0, -1.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0;
  T.translation() = Eigen::Vector3d(0.0, -0.08, -0.27);
  return T;
}

std::string calibration_text(const Eigen::Isometry3d& T_cam_lidar) {
  // KITTI's own projections; no image belongs to a simulated drive, but readers expect the rows.
  constexpr std::string_view kProjection =
      "7.188560000000e+02 0.000000000000e+00 6.071928000000e+02 {} 0.000000000000e+00 "
      "7.188560000000e+02 1.852157000000e+02 0.000000000000e+00 0.000000000000e+00 "
      "0.000000000000e+00 1.000000000000e+00 0.000000000000e+00\n";
  std::string text;
  for (int camera = 0; camera < 4; ++camera) {
    const double baseline = camera % 2 == 1 ? -386.1448 : 0.0;
    text += fmt::format("P{}: ", camera);
    text += fmt::format(fmt::runtime(kProjection), fmt::format("{:.12e}", baseline));
  }
  return text + "Tr: " + row_of(T_cam_lidar) + "\n";
}

}  // namespace

DriveWriter::DriveWriter(const std::filesystem::path& target) : folder_(target) {
  std::filesystem::create_directory(folder_.path() / "velodyne");
  std::filesystem::create_directory(folder_.path() / "labels");
}

void DriveWriter::add(const SimulatedScan& scan, std::vector<maps::Box> boxes,
                      const Eigen::Isometry3d& T_world_lidar, double time_s) {
  const std::size_t index = T_world_lidar_.size();
  write(folder_.path() / fmt::format("velodyne/{:06}.bin", index),
        std::as_bytes(std::span(scan.points)));
  write(folder_.path() / fmt::format("labels/{:06}.label", index),
        std::as_bytes(std::span(scan.labels)));
  boxes_.by_scan[index] = std::move(boxes);
  T_world_lidar_.push_back(T_world_lidar);
  times_s_.push_back(time_s);
}

void DriveWriter::publish() {
  const Eigen::Isometry3d T_cam_lidar = make_T_cam_lidar();
  std::string poses;
  std::string times;
  for (std::size_t i = 0; i < T_world_lidar_.size(); ++i) {
    const Eigen::Isometry3d T_first_lidar = T_world_lidar_.front().inverse() * T_world_lidar_[i];
    poses += row_of(T_cam_lidar * T_first_lidar * T_cam_lidar.inverse()) + "\n";
    times += fmt::format("{:.6e}\n", times_s_[i]);
  }
  write(folder_.path() / "calib.txt", calibration_text(T_cam_lidar));
  write(folder_.path() / "poses.txt", poses);
  write(folder_.path() / "times.txt", times);
  maps::write_boxes(folder_.path() / "boxes.json", boxes_);
  folder_.publish();
}

}  // namespace stillmap::simulation
