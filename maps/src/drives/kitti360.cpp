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

/// The first line with this key before 12 numbers; without a key, the first line.
Eigen::Isometry3d read_rigid(const fs::path& file, std::string_view key) {
  const std::string text = read_text(file);
  for (NumberLine& line : number_lines(text)) {
    if (!key.empty()) {
      if (line.fields.front() != key) continue;
      line.fields.erase(line.fields.begin());
    }
    Eigen::Isometry3d T = parse_kitti_pose(file, line);
    check_lever_arm(T.translation(), file);
    return T;
  }
  throw InputError(file.string(), "no line " + std::string(key.empty() ? "of numbers" : key),
                   "12 numbers, as KITTI-360 has them: copy its calibration folder");
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
  for (const char* const name : {"calib_cam_to_velo.txt", "calib_cam_to_pose.txt"})
    if (!fs::exists(calibration / name))
      throw InputError((calibration / name).string(), "no file",
                       "KITTI-360's calibration, which brings its poses to the lidar: copy the "
                       "folder calibration beside data_poses");
  const Eigen::Isometry3d T_lidar_cam = read_rigid(calibration / "calib_cam_to_velo.txt", "");
  const Eigen::Isometry3d T_cam_lidar = T_lidar_cam.inverse();
  if (is_of_camera) return T_cam_lidar;
  return renormalized(read_rigid(calibration / "calib_cam_to_pose.txt", "image_00:") * T_cam_lidar);
}

}  // namespace stillmap::maps
