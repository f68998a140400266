#include "checks/viewpoint_check.hpp"

#include <vector>

#include "bags/frame_tree.hpp"
#include "drives/drive_sample.hpp"
#include "drives/layout.hpp"
#include "formats/pcd.hpp"

namespace stillmap::maps {
namespace {

std::optional<Eigen::Isometry3d> viewpoint_of(const Drive& drive, std::size_t scan) {
  const std::filesystem::path& file = drive.contents().scan_files[scan];
  if (file.extension() != ".pcd") return std::nullopt;
  return read_pcd_viewpoint(file);
}

bool is_other_than_identity(const Drive& drive, const std::vector<SamplePair>& pairs) {
  for (const SamplePair& pair : pairs) {
    const auto viewpoint = viewpoint_of(drive, pair.first);
    if (viewpoint && !viewpoint->matrix().isIdentity(0.0)) return true;
  }
  return false;
}

DriveFinding no_poses(const Drive& drive) {
  const bool pcd = drive.contents().scan_files.front().extension() == ".pcd";
  const std::string& frame = drive.contents().entries.frame_id;
  if (is_recording(drive.contents().layout) && is_map_frame(frame))
    return {"no_poses",
            "no poses, but clouds in '" + frame +
                "', a frame that is fixed to the ground: if they are registered already, odometry "
                "finds no motion",
            "record the sensor's poses too, or give a file of poses (--poses) and choose "
            "points=map; if the "
            "points lie in the sensor's frame, nothing is wrong"};
  if (is_recording(drive.contents().layout))
    return {"no_poses", "no poses: none are taken of the recording",
            "choose the poses that the notes name, or give a file of poses (--poses); without "
            "poses, build "
            "finds them by odometry"};
  return {
      "no_poses",
      pcd ? "no poses: no file of them, and no VIEWPOINT of the scans is other than the identity"
          : "no poses: no file of them",
      "give a file of poses (--poses) where there is one; without, odometry makes them of the "
      "scans"};
}

}  // namespace

std::optional<DriveFinding> check_viewpoints(const Drive& drive) {
  if (drive.has_poses() || drive.size() == 0) return std::nullopt;
  if (drive.contents().layout != DriveLayout::kScanFolder) return no_poses(drive);
  const std::vector<SamplePair> pairs =
      choose_samples(drive.size(), [&](std::size_t i) { return viewpoint_of(drive, i); });
  if (!is_other_than_identity(drive, pairs)) return no_poses(drive);
  return DriveFinding{
      "viewpoints_not_applied",
      "the scans have VIEWPOINTs other than the identity, which are not taken as poses: scans do "
      "not overlap better with them",
      "where they are the scans' poses, choose them: 'DRIVE?points=sensor' with points in the "
      "sensor's frame, 'DRIVE?points=map' with points in that of the VIEWPOINTs"};
}

}  // namespace stillmap::maps
