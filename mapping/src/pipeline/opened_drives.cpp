#include "pipeline/opened_drives.hpp"

#include "odometry/run_odometry.hpp"
#include "trajectory/common_frame.hpp"
#include "trajectory/drive_pose_faults.hpp"
#include "trajectory/given_pose_errors.hpp"

#include <stillmap/mapping/odometry.hpp>
#include <stillmap/mapping/trajectory.hpp>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <stdexcept>
#include <utility>

namespace stillmap::mapping {
namespace {

constexpr std::string_view kGiven = "given";
bool have_poses(const std::vector<maps::Drive>& drives) {
  return std::all_of(drives.begin(), drives.end(),
                     [](const maps::Drive& drive) { return drive.has_poses(); });
}

/// The drive with the place of its frame that the options give.
maps::Drive placed(const maps::Drive& drive, const MapBuildOptions& options) {
  if (!options.geodetic_origin) return drive;
  const std::string name = drive.contents().root.string();
  if (!drive.has_poses())
    throw maps::InputError(name, "no poses beside a geodetic origin",
                           "poses in a frame whose x is east and y is north: give --poses FILE, or "
                           "leave out --geo-origin");
  if (drive.contents().origin)
    throw maps::InputError(name, "a drive that says where its poses lie",
                           "none in its recording: leave out --geo-origin");
  maps::Drive::Contents contents = drive.contents();
  contents.origin = options.geodetic_origin;
  return maps::Drive(std::move(contents));
}

maps::Drive open_drive(const std::filesystem::path& folder, const MapBuildOptions& options,
                       double found_offset_s) {
  const double offset_s = options.pose_time_offset_s + found_offset_s;
  return placed(maps::Drive::open(folder, options.poses_file, std::llround(1e9 * offset_s)),
                options);
}

/// A shift may leave out scans before those that were measured: a selection would be of others.
void require_same_numbers(const maps::Drive& drive, const maps::Drive& shifted,
                          const MapBuildOptions& options, double found_offset_s) {
  const maps::Selection& selection = options.selection;
  const bool is_whole =
      selection.begin == 0 && selection.end.value_or(drive.size()) >= drive.size();
  if (is_whole || drive.stamp_ns(0) == shifted.stamp_ns(0)) return;
  throw maps::InputError(
      drive.contents().root.string(),
      fmt::format("another first scan with a pose, from which --select counts, once {:.3f} s are "
                  "added to the stamps of the poses (--pose-time-offset auto)",
                  found_offset_s),
      fmt::format("--pose-time-offset {:.3f} and --select counted from that scan, or no --select",
                  options.pose_time_offset_s + found_offset_s));
}

}  // namespace

std::vector<maps::Drive> open_drives(const std::vector<std::filesystem::path>& folders,
                                     const MapBuildOptions& options) {
  if (folders.empty()) throw std::invalid_argument("drives: none, expected at least one");
  if (options.poses_file && folders.size() > 1)
    throw std::invalid_argument(
        "poses file (--poses): found with several drives, expected one drive: put each drive's "
        "poses beside its scans");
  std::vector<maps::Drive> drives;
  for (const std::filesystem::path& folder : folders)
    drives.push_back(open_drive(folder, options, 0.0));
  return drives;
}

std::vector<maps::Drive> shifted_by(const std::vector<double>& offsets_s,
                                    const std::vector<std::filesystem::path>& folders,
                                    const std::vector<maps::Drive>& drives,
                                    const MapBuildOptions& options) {
  std::vector<maps::Drive> shifted;
  for (std::size_t i = 0; i < drives.size(); ++i) {
    if (offsets_s[i] == 0.0) {
      shifted.push_back(drives[i]);
      continue;
    }
    shifted.push_back(
        open_drive(folders[i], options, offsets_s[i]).with_imu(drives[i].contents().imu));
    require_same_numbers(drives[i], shifted.back(), options, offsets_s[i]);
  }
  return shifted;
}

std::string odometry_of(const std::vector<maps::Drive>& drives, const MapBuildOptions& options) {
  std::string method = options.odometry.value_or(have_poses(drives) ? std::string(kGiven)
                                                                    : odometry_names().front());
  const bool believes = options.trajectory.prior || options.trajectory.gnss_sigma_m;
  // Who says how good the poses are wants them to be improved.
  if (believes && !options.odometry) method = odometry_names().front();
  if (method == kGiven) {
    if (believes)
      throw std::invalid_argument(
          "odometry (--odometry): found given beside a prior (--pose-sigma) or GNSS "
          "(--gnss-sigma), expected " +
          fmt::format("{}", fmt::join(odometry_names(), " or ")));
    for (const maps::Drive& drive : drives) {
      if (!drive.has_poses())
        throw maps::InputError(drive.contents().root.string(), "a drive without poses",
                               "poses: give --poses FILE, or leave out --odometry given");
    }
    return method;
  }
  const std::vector<std::string> names = odometry_names();
  if (std::find(names.begin(), names.end(), method) == names.end())
    throw std::invalid_argument(fmt::format("odometry (--odometry): found '{}', expected {} or {}",
                                            method, kGiven, fmt::join(names, ", ")));
  return method;
}

bool uses_given_poses(const std::string& odometry, const MapBuildOptions& options) {
  return odometry == kGiven || options.trajectory.prior || options.trajectory.gnss_sigma_m;
}

std::vector<maps::Drive> in_one_frame(const std::vector<maps::Drive>& drives) {
  std::vector<maps::Drive> moved;
  for (const maps::Drive& drive : drives) {
    const Eigen::Isometry3d T = T_first_own(drives.front(), drive);
    if (T.matrix().isIdentity(0.0)) {
      moved.push_back(drive);
      continue;
    }
    std::vector<Eigen::Isometry3d> poses = drive.contents().T_map_lidar;
    for (Eigen::Isometry3d& pose : poses) pose = T * pose;
    moved.push_back(drive.with_poses(std::move(poses), drives.front().contents().origin));
  }
  return moved;
}

}  // namespace stillmap::mapping
