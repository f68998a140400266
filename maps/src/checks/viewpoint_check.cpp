#include "checks/viewpoint_check.hpp"

#include <fmt/format.h>

#include <array>
#include <utility>
#include <vector>

#include "checks/drive_sample.hpp"
#include "drives/layout.hpp"
#include "formats/pcd.hpp"

namespace stillmap::maps {
namespace {

/// Scans as if each VIEWPOINT were the pose of its points, and as if the points had been moved by
/// it already.
struct Readings {
  std::vector<std::array<PosedScan, 2>> as_poses, moved_already;

  void add(const Drive& drive, const std::array<std::size_t, 2>& pair,
           const std::array<Eigen::Isometry3d, 2>& viewpoints) {
    as_poses.emplace_back();
    moved_already.emplace_back();
    for (std::size_t i = 0; i < pair.size(); ++i) {
      PointCloud cloud = drive.read(pair[i]).cloud;
      as_poses.back()[i] = {viewpoints[i], standing_points(cloud)};
      // In doubles: what lies in a map may lie far from its origin.
      const Eigen::Isometry3d T_lidar_map = viewpoints[i].inverse();
      for (Eigen::Vector3f& p : cloud.positions) p = (T_lidar_map * p.cast<double>()).cast<float>();
      moved_already.back()[i] = {viewpoints[i], standing_points(cloud)};
    }
  }
};

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
  if (is_recording(drive.contents().layout))
    return {"no_poses", "no poses: none are taken of the recording",
            "choose the poses that the notes name, or give --poses FILE (KITTI or TUM); without "
            "poses, build finds them by odometry"};
  return {
      "no_poses",
      pcd ? "no poses: no file of them, and no VIEWPOINT of the scans is other than the identity"
          : "no poses: no file of them",
      "give them with --poses FILE (KITTI or TUM) where there are any; without, odometry makes "
      "them of the scans"};
}

/// What VIEWPOINTs that are no poses of this drive may be.
DriveFinding not_applied(const std::string& what) {
  return {
      "viewpoints_not_applied", what,
      "where they are the scans' poses, write them as lines of TUM (stamp tx ty tz qx qy qz qw; "
      "VIEWPOINT has qw before qx) and give these with --poses"};
}

}  // namespace

std::optional<DriveFinding> check_viewpoints(const Drive& drive) {
  if (drive.has_poses() || drive.size() == 0) return std::nullopt;
  if (drive.contents().layout != DriveLayout::kScanFolder) return no_poses(drive);
  const std::vector<SamplePair> pairs =
      choose_samples(drive.size(), [&](std::size_t i) { return viewpoint_of(drive, i); });
  if (!is_other_than_identity(drive, pairs)) return no_poses(drive);
  Readings readings;
  for (const SamplePair& pair : pairs) {
    if (!pair.second) continue;
    readings.add(
        drive, {pair.first, *pair.second},
        {viewpoint_of(drive, pair.first).value(), viewpoint_of(drive, *pair.second).value()});
  }
  const auto as_poses = compare_readings(readings.as_poses);
  const auto moved_already = compare_readings(readings.moved_already);
  if (!as_poses || !moved_already)
    return not_applied("the scans have VIEWPOINTs other than the identity, which are not applied");
  if (is_better(moved_already->given, *as_poses))
    return DriveFinding{
        "points_in_map_frame",
        fmt::format(
            "the points of the scans lie in one frame already: scans apart by their "
            "VIEWPOINTs overlap by {:.0f} % as they are, and by {:.0f} % when they are moved",
            100.0 * moved_already->given, 100.0 * as_poses->given),
        "bring each scan back to its sensor by the inverse of its VIEWPOINT, and give the "
        "VIEWPOINTs with --poses"};
  if (as_poses->given > as_poses->without)
    return not_applied(
        fmt::format("no file of poses, but VIEWPOINTs that look like them and are not applied: "
                    "scans overlap by {:.0f} % with these, and by {:.0f} % without",
                    100.0 * as_poses->given, 100.0 * as_poses->without));
  return not_applied("the scans have VIEWPOINTs other than the identity, which are not applied");
}

}  // namespace stillmap::maps
