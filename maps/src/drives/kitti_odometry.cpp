#include "drives/kitti_odometry.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/frames.hpp>

#include <fmt/format.h>

#include "drives/calibration.hpp"
#include "drives/layout.hpp"

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

std::optional<fs::path> odometry_poses(const fs::path& root) {
  const fs::path inside = root / "poses.txt";
  if (fs::exists(inside)) return inside;
  const fs::path sequence = fs::canonical(root);
  const fs::path beside =
      sequence.parent_path().parent_path() / "poses" / (sequence.filename().string() + ".txt");
  if (fs::exists(beside)) return beside;
  return std::nullopt;
}

void set_camera_poses(Drive::Contents& contents, const fs::path& poses_file) {
  const Eigen::Isometry3d T_cam_velo = read_T_cam_velo(contents.root / "calib.txt");
  const Eigen::Isometry3d T_velo_cam = T_cam_velo.inverse();
  const std::vector<Eigen::Isometry3d> T_world_cam = read_kitti_poses(poses_file);
  set_position_step(contents, T_world_cam);
  for (const std::size_t line :
       lines_of_scans(contents.scan_files, T_world_cam.size(), poses_file, "poses")) {
    contents.T_map_lidar.push_back(renormalized(T_velo_cam * T_world_cam[line] * T_cam_velo));
  }
}

}  // namespace

bool is_kitti_odometry(const fs::path& root) {
  return !list_files(root / "velodyne", ".bin").empty();
}

Drive::Contents open_kitti_odometry(const fs::path& root, const PosesChoice& choice) {
  Drive::Contents contents;
  contents.layout = DriveLayout::kKittiOdometry;
  contents.root = root;
  contents.scan_files = list_files(root / "velodyne", ".bin");
  if (fs::exists(root / "times.txt")) {
    set_times(contents, root / "times.txt");
  } else {
    assume_times(contents);
  }
  set_labels(contents);
  const std::optional<fs::path> own = odometry_poses(root);
  if (choice.file) {
    set_poses(contents, *choice.file, choice.offset_ns);
  } else if (own) {
    set_camera_poses(contents, *own);
  } else {
    contents.notes.emplace_back("no poses.txt: a drive without poses");
  }
  leave_out_unordered(contents);
  return contents;
}

}  // namespace stillmap::maps
