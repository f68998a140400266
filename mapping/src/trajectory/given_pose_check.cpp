#include "odometry/run_odometry.hpp"
#include "trajectory/drive_pose_faults.hpp"

#include <stillmap/mapping/given_pose_check.hpp>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <cstdint>

namespace stillmap::mapping {
namespace {

/// Of the scans that the posed drive has, too.
std::vector<OdometryPose> odometry_at(const maps::Drive& posed, const maps::Drive& scans,
                                      const std::vector<OdometryPose>& odometry) {
  std::vector<OdometryPose> found;
  std::size_t scan = 0;
  for (const std::int64_t stamp_ns : posed.contents().stamps_ns) {
    while (scan < scans.size() && scans.stamp_ns(scan) < stamp_ns) ++scan;
    if (scan == scans.size() || scans.stamp_ns(scan) != stamp_ns)
      throw maps::InputError(
          posed.contents().root.string(),
          fmt::format("a scan at {} ns by the poses file, which the drive does not have", stamp_ns),
          "stamps of the drive's own: use a drive whose names or files tell the stamps of its "
          "scans");
    found.push_back(odometry[scan]);
  }
  return found;
}

}  // namespace

std::vector<std::vector<maps::DriveFinding>> check_given_poses(const maps::Drive& scans,
                                                               std::span<const maps::Drive> posed,
                                                               bool guided,
                                                               const ProgressCallback& progress,
                                                               const CancelFlag& cancel) {
  std::vector<OdometryPose> of_scans;
  if (!guided && std::ranges::any_of(posed, &maps::Drive::has_poses))
    of_scans = run_odometry({.drive = scans, .end = scans.size()}, 0, progress, cancel);
  std::vector<std::vector<maps::DriveFinding>> found;
  for (const maps::Drive& drive : posed) {
    if (!drive.has_poses()) {
      found.emplace_back();
      continue;
    }
    const std::vector<OdometryPose> odometry =
        guided ? run_odometry({.drive = drive, .end = drive.size(), .expects_given_poses = true}, 0,
                              progress, cancel)
               : odometry_at(drive, scans, of_scans);
    found.push_back(findings_of(faults_of(drive, 0, odometry)));
  }
  return found;
}

std::string to_json(std::span<const maps::DriveFinding> findings) {
  nlohmann::json json = nlohmann::json::array();
  for (const maps::DriveFinding& finding : findings)
    json.push_back({{"code", finding.code}, {"what", finding.what}, {"remedy", finding.remedy}});
  return json.dump();
}

}  // namespace stillmap::mapping
