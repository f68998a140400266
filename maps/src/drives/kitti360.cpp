#include "drives/kitti360.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/frames.hpp>

#include <array>
#include <span>
#include <string>
#include <vector>

#include <stillmap/maps/text.hpp>
#include "drives/calibration.hpp"
#include "formats/pose_line.hpp"

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

/// The first line with this key before its numbers, without the key; without one, the first line.
NumberLine line_with(const fs::path& file, const std::string& text, std::string_view key) {
  for (NumberLine& line : number_lines(text)) {
    if (!key.empty()) {
      if (line.fields.front() != key) continue;
      line.fields.erase(line.fields.begin());
    }
    return line;
  }
  throw InputError(file.string(), "no line " + std::string(key.empty() ? "of numbers" : key),
                   "one, as KITTI-360 has it: copy its calibration folder");
}

Eigen::Isometry3d read_rigid(const fs::path& file, std::string_view key) {
  const std::string text = read_text(file);
  Eigen::Isometry3d T = parse_kitti_pose(file, line_with(file, text, key));
  check_lever_arm(T.translation(), file);
  return T;
}

/// Turns the left camera to the one whose images are rectified.
Eigen::Isometry3d read_rectification(const fs::path& file) {
  const std::string text = read_text(file);
  const NumberLine line = line_with(file, text, "R_rect_00:");
  std::array<double, 9> n{};
  parse_finite(file, line, n);
  return pose_of_matrix(
      file, line.line,
      std::array{n[0], n[1], n[2], 0.0, n[3], n[4], n[5], 0.0, n[6], n[7], n[8], 0.0});
}

}  // namespace

std::optional<fs::path> kitti360_poses(const fs::path& root) {
  const fs::path drive = fs::canonical(root);
  const fs::path file =
      drive.parent_path().parent_path() / "data_poses" / drive.filename() / "poses.txt";
  if (!fs::exists(file)) return std::nullopt;
  return file;
}

std::optional<Eigen::Isometry3d> lidar_of_kitti360_poses(const fs::path& poses_file) {
  const fs::path file = fs::weakly_canonical(poses_file);
  const fs::path data_poses = file.parent_path().parent_path();
  const bool is_of_camera = file.filename() == "cam0_to_world.txt";
  if (data_poses.filename() != "data_poses" || (!is_of_camera && file.filename() != "poses.txt"))
    return std::nullopt;
  const fs::path calibration = data_poses.parent_path() / "calibration";
  const char* const of_pose = is_of_camera ? "perspective.txt" : "calib_cam_to_pose.txt";
  for (const char* const name : {"calib_cam_to_velo.txt", of_pose})
    if (!fs::exists(calibration / name))
      throw InputError((calibration / name).string(), "no file",
                       "KITTI-360's calibration, which brings its poses to the lidar: copy the "
                       "folder calibration beside data_poses" +
                           std::string(is_of_camera ? ", or give poses.txt" : ""));
  const Eigen::Isometry3d T_lidar_cam = read_rigid(calibration / "calib_cam_to_velo.txt", "");
  const Eigen::Isometry3d T_cam_lidar = T_lidar_cam.inverse();
  const Eigen::Isometry3d T_pose_cam = is_of_camera
                                           ? read_rectification(calibration / of_pose)
                                           : read_rigid(calibration / of_pose, "image_00:");
  return renormalized(T_pose_cam * T_cam_lidar);
}

}  // namespace stillmap::maps
