#include "pipeline/posed_drives.hpp"

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
/// A loop counts as believed from here.
constexpr double kBelieved = 0.5;

bool have_poses(const std::vector<maps::Drive>& drives) {
  return std::all_of(drives.begin(), drives.end(),
                     [](const maps::Drive& drive) { return drive.has_poses(); });
}

/// One scan more than selected at both ends, so that each selected one has neighbours to take its
/// speed from.
TrajectoryOptions options_of(const MapBuildOptions& options, const std::string& method) {
  TrajectoryOptions trajectory = options.trajectory;
  trajectory.odometry = method;
  trajectory.begin = options.selection.begin > 0 ? options.selection.begin - 1 : 0;
  constexpr std::size_t kMost = std::numeric_limits<std::size_t>::max();
  if (const auto end = options.selection.end) trajectory.end = *end < kMost ? *end + 1 : kMost;
  trajectory.threads = options.threads;
  return trajectory;
}

std::map<std::string, std::uint64_t> counts_of(const TrajectoryEstimate& estimate) {
  std::map<std::string, std::uint64_t> counts;
  counts["loops_found"] = estimate.loops.size();
  counts["loops_believed"] = static_cast<std::uint64_t>(
      std::count_if(estimate.loops.begin(), estimate.loops.end(),
                    [](const EstimatedLoop& loop) { return loop.weight >= kBelieved; }));
  std::uint64_t& keyframes = counts["key_frames"];
  std::uint64_t& predicted = counts["scans_predicted"];
  for (const EstimatedDrive& drive : estimate.drives) {
    keyframes += drive.keyframes.size();
    predicted += static_cast<std::uint64_t>(std::count_if(
        drive.odometry.begin() + 1, drive.odometry.end(),
        [](const OdometryPose& pose) { return pose.status == OdometryStatus::kPredicted; }));
  }
  return counts;
}

/// The drive with the place of its frame that the options give.
maps::Drive placed(const maps::Drive& drive, const MapBuildOptions& options) {
  if (!options.geodetic_origin) return drive;
  const std::string name = drive.contents().root.string();
  if (!drive.has_poses())
    throw maps::InputError(name, "no poses beside a geodetic origin",
                           "poses in a frame whose x is east and y is north");
  if (drive.contents().origin)
    throw maps::InputError(name, "a drive that says where its poses lie", "no --geo-origin");
  maps::Drive::Contents contents = drive.contents();
  contents.origin = options.geodetic_origin;
  return maps::Drive(std::move(contents));
}

/// @param applied_offsets_s  to the poses of each drive.
std::vector<maps::DriveFinding> faults_in(const std::vector<maps::Drive>& drives,
                                          const TrajectoryEstimate& estimate,
                                          std::span<const double> applied_offsets_s) {
  std::vector<maps::DriveFinding> faults;
  for (std::size_t i = 0; i < drives.size(); ++i) {
    const EstimatedDrive& estimated = estimate.drives[i];
    for (maps::DriveFinding& fault :
         findings_of(faults_of(drives[i], estimated.begin, estimated.odometry),
                     {applied_offsets_s[i], drives.size() > 1})) {
      fault.what = drives[i].contents().root.string() + ": " + fault.what;
      faults.push_back(std::move(fault));
    }
  }
  return faults;
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

/// Scans before the estimated ones and after them have poses of no use.
std::vector<maps::Drive> posed_by(const TrajectoryEstimate& estimate,
                                  const std::vector<maps::Drive>& drives) {
  std::vector<maps::Drive> posed;
  for (std::size_t i = 0; i < drives.size(); ++i) {
    const EstimatedDrive& estimated = estimate.drives[i];
    std::vector<Eigen::Isometry3d> poses(drives[i].size(), estimated.T_map_lidar.front());
    std::copy(estimated.T_map_lidar.begin(), estimated.T_map_lidar.end(),
              poses.begin() + static_cast<std::ptrdiff_t>(estimated.begin));
    posed.push_back(drives[i].with_poses(std::move(poses), estimate.origin));
  }
  return posed;
}

using Disagreements = std::vector<std::vector<maps::PoseDisagreement>>;

/// One a scan of each drive. @param of  takes an estimated drive and its number.
template <typename Of>
Disagreements in_drives(const std::vector<maps::Drive>& drives, const TrajectoryEstimate& estimate,
                        const Of& of) {
  Disagreements all;
  for (std::size_t i = 0; i < drives.size(); ++i) {
    const std::vector<maps::PoseDisagreement> found = of(estimate.drives[i], i);
    all.emplace_back(drives[i].size());
    std::ranges::copy(found,
                      all.back().begin() + static_cast<std::ptrdiff_t>(estimate.drives[i].begin));
  }
  return all;
}

/// The drives' own poses, and odometry's.
TwicePosed twice_posed(const maps::Drive& drive, const EstimatedDrive& estimated) {
  return {
      estimated.odometry,
      std::span(drive.contents().T_map_lidar).subspan(estimated.begin, estimated.odometry.size())};
}

/// What cleaning allows for. @param given  whether the drives' own poses are used.
Disagreements doubts_in(const std::vector<maps::Drive>& drives, const TrajectoryEstimate& estimate,
                        bool given) {
  return in_drives(drives, estimate, [&](const EstimatedDrive& drive, std::size_t i) {
    return given ? doubts_of(twice_posed(drives[i], drive)) : doubts_of(drive.odometry);
  });
}

/// Loops and given poses may have pulled an estimate elsewhere than odometry.
Disagreements disagreements_in(const std::vector<maps::Drive>& drives,
                               const TrajectoryEstimate& estimate, bool given) {
  return in_drives(drives, estimate, [&](const EstimatedDrive& drive, std::size_t i) {
    return disagreements_of(given ? twice_posed(drives[i], drive)
                                  : TwicePosed{drive.odometry, drive.T_map_lidar});
  });
}

/// @param is_joined  where poses are given, nothing begins anew.
std::vector<std::vector<ScanNote>> notes_in(const std::vector<maps::Drive>& drives,
                                            const TrajectoryEstimate& estimate, bool is_joined) {
  std::vector<std::vector<ScanNote>> notes;
  for (std::size_t i = 0; i < drives.size(); ++i) {
    std::vector<ScanNote>& of_drive = notes.emplace_back(drives[i].size(), ScanNote::kNone);
    const EstimatedDrive& estimated = estimate.drives[i];
    for (std::size_t k = 0; k < estimated.odometry.size(); ++k) {
      const OdometryPose& pose = estimated.odometry[k];
      if (pose.hidden) of_drive[estimated.begin + k] = ScanNote::kHidden;
      if (pose.begins_anew && !is_joined) of_drive[estimated.begin + k] = ScanNote::kBeginsAnew;
    }
  }
  return notes;
}

PoseDifferences moves_of(const std::vector<maps::Drive>& given,
                         const std::vector<maps::Drive>& refined,
                         const TrajectoryEstimate& estimate) {
  DifferenceList moves;
  for (std::size_t i = 0; i < given.size(); ++i) {
    const std::size_t begin = estimate.drives[i].begin;
    for (std::size_t scan = begin; scan < begin + estimate.drives[i].odometry.size(); ++scan)
      moves.add(given[i].T_map_lidar(scan), refined[i].T_map_lidar(scan));
  }
  return summary(moves);
}

}  // namespace

std::vector<maps::Drive> open_drives(const std::vector<std::filesystem::path>& folders,
                                     const MapBuildOptions& options) {
  if (folders.empty()) throw std::invalid_argument("drives: none, expected at least one");
  if (options.poses_file && folders.size() > 1)
    throw std::invalid_argument("poses file: found with several drives, expected one drive");
  std::vector<maps::Drive> drives;
  for (const std::filesystem::path& folder : folders)
    drives.push_back(open_drive(folder, options, 0.0));
  return drives;
}

std::vector<double> found_pose_time_offsets(const std::vector<maps::Drive>& drives,
                                            const MapBuildOptions& options,
                                            const ProgressCallback& progress,
                                            const CancelFlag& cancel) {
  std::vector<double> offsets_s(drives.size(), 0.0);
  for (std::size_t i = 0; i < drives.size(); ++i) {
    const maps::Drive& drive = drives[i];
    if (!drive.has_poses()) continue;
    const std::size_t end = std::min(options.selection.end.value_or(drive.size()), drive.size());
    const std::size_t begin = std::min(options.selection.begin, end);
    const std::vector<OdometryPose> odometry = run_odometry(
        {.drive = drive, .begin = begin, .end = end}, options.threads, progress, cancel);
    offsets_s[i] = faults_of(drive, begin, odometry).offset_s.value_or(0.0);
  }
  return offsets_s;
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
    shifted.push_back(open_drive(folders[i], options, offsets_s[i]));
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
      throw std::invalid_argument("odometry: found given beside a prior or GNSS, expected " +
                                  fmt::format("{}", fmt::join(odometry_names(), " or ")));
    for (const maps::Drive& drive : drives) {
      if (!drive.has_poses())
        throw maps::InputError(drive.contents().root.string(), "a drive without poses",
                               "poses in its layout or a file given with --poses, or odometry");
    }
    return method;
  }
  const std::vector<std::string> names = odometry_names();
  if (std::find(names.begin(), names.end(), method) == names.end())
    throw std::invalid_argument(fmt::format("odometry: found '{}', expected {} or {}", method,
                                            kGiven, fmt::join(names, ", ")));
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

PosedDrives with_given_poses(const std::vector<maps::Drive>& drives, const MapBuildOptions& options,
                             std::span<const double> applied_offsets_s,
                             const std::filesystem::path& scratch, const ProgressCallback& progress,
                             const CancelFlag& cancel) {
  PosedDrives posed;
  posed.drives = in_one_frame(drives);
  const bool refines = options.given_poses == GivenPosesUse::kRefine;
  TrajectoryOptions trajectory = options_of(options, odometry_names().front());
  trajectory.refine_given = true;
  trajectory.loops = refines && trajectory.loops;
  const TrajectoryEstimate estimate =
      estimate_trajectories(posed.drives, trajectory, scratch, progress, cancel);
  GivenPosesResult report;
  report.use = options.given_poses;
  report.errors = estimate.given_errors.value();
  posed.faults = faults_in(drives, estimate, applied_offsets_s);
  const bool moves = refines && !report.errors.agree();
  posed.doubts = doubts_in(posed.drives, estimate, !moves);
  posed.disagreements = disagreements_in(posed.drives, estimate, !moves);
  posed.notes = notes_in(posed.drives, estimate, true);
  if (moves) {
    posed.counts = counts_of(estimate);
    posed.graph = drive_graph_of(estimate);
    const std::vector<maps::Drive> given = std::exchange(posed.drives, posed_by(estimate, drives));
    report.moved = moves_of(given, posed.drives, estimate);
  }
  posed.given = report;
  return posed;
}

PosedDrives with_estimated_poses(const std::vector<maps::Drive>& drives,
                                 const MapBuildOptions& options, const std::string& method,
                                 std::span<const double> applied_offsets_s,
                                 const std::filesystem::path& scratch,
                                 const ProgressCallback& progress, const CancelFlag& cancel) {
  const TrajectoryEstimate estimate =
      estimate_trajectories(drives, options_of(options, method), scratch, progress, cancel);
  PosedDrives posed;
  posed.drives = posed_by(estimate, drives);
  posed.counts = counts_of(estimate);
  posed.graph = drive_graph_of(estimate);
  posed.doubts = doubts_in(drives, estimate, false);
  posed.disagreements = disagreements_in(drives, estimate, false);
  const bool asks_given = uses_given_poses(method, options);
  posed.notes = notes_in(drives, estimate, asks_given);
  if (asks_given) posed.faults = faults_in(drives, estimate, applied_offsets_s);
  return posed;
}

}  // namespace stillmap::mapping
