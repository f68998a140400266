#include "pipeline/poses_stage.hpp"

#include "odometry/run_odometry.hpp"
#include "pipeline/build.hpp"
#include "pipeline/build_journal.hpp"
#include "pipeline/build_key.hpp"
#include "pipeline/build_warnings.hpp"
#include "pipeline/opened_drives.hpp"
#include "pipeline/posed_drives_bytes.hpp"
#include "pipeline/registered_bytes.hpp"
#include "registration/map_registration.hpp"
#include "stacking/voxel_grid.hpp"
#include "trajectory/drive_pose_faults.hpp"
#include "trajectory/given_pose_errors.hpp"

#include <stillmap/mapping/odometry.hpp>
#include <stillmap/mapping/trajectory.hpp>
#include <stillmap/maps/error.hpp>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <iterator>
#include <limits>
#include <span>
#include <sstream>
#include <stdexcept>
#include <utility>

namespace stillmap::mapping {
namespace {

/// A loop counts as believed from here.
constexpr double kBelieved = 0.5;

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

/// What was added to the stamps of a drive's poses [s].
double applied_offset_s(const Build& build, std::size_t drive) {
  const std::vector<double>& found_s = build.result.found_pose_time_offsets_s;
  return build.task.options.pose_time_offset_s + (found_s.empty() ? 0.0 : found_s[drive]);
}

std::vector<maps::DriveFinding> faults_in(const Build& build, const TrajectoryEstimate& estimate) {
  const std::vector<maps::Drive>& drives = build.shifted;
  std::vector<maps::DriveFinding> faults;
  for (std::size_t i = 0; i < drives.size(); ++i) {
    const EstimatedDrive& estimated = estimate.drives[i];
    for (maps::DriveFinding& fault :
         findings_of(faults_of(drives[i], estimated.begin, estimated.odometry),
                     {applied_offset_s(build, i), drives.size() > 1})) {
      fault.what = drives[i].contents().root.string() + ": " + fault.what;
      faults.push_back(std::move(fault));
    }
  }
  return faults;
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

/// What the scans' motion says is to be added to the stamps of each drive's poses [s]; 0 where it
/// tells nothing.
std::vector<double> found_pose_time_offsets(const BuildTask& task) {
  const std::vector<maps::Drive>& drives = task.drives;
  const MapBuildOptions& options = task.options;
  std::vector<double> offsets_s(drives.size(), 0.0);
  for (std::size_t i = 0; i < drives.size(); ++i) {
    const maps::Drive& drive = drives[i];
    if (!drive.has_poses()) continue;
    const std::size_t end = std::min(options.selection.end.value_or(drive.size()), drive.size());
    const std::size_t begin = std::min(options.selection.begin, end);
    const std::vector<OdometryPose> odometry = run_odometry(
        {.drive = drive, .begin = begin, .end = end}, options.threads, task.progress, task.cancel);
    offsets_s[i] = faults_of(drive, begin, odometry).offset_s.value_or(0.0);
  }
  return offsets_s;
}

PosedDrives with_given_poses(const Build& build) {
  const std::vector<maps::Drive>& drives = build.shifted;
  const BuildTask& task = build.task;
  PosedDrives posed;
  posed.drives = in_one_frame(drives);
  const bool refines = task.options.given_poses == GivenPosesUse::kRefine;
  TrajectoryOptions trajectory = options_of(task.options, odometry_names().front());
  trajectory.refine_given = true;
  trajectory.loops = refines && trajectory.loops;
  const TrajectoryEstimate estimate =
      estimate_trajectories(posed.drives, trajectory, task.scratch, task.progress, task.cancel);
  GivenPosesResult result;
  result.use = task.options.given_poses;
  result.errors = estimate.given_errors.value();
  posed.faults = faults_in(build, estimate);
  const bool moves = refines && !result.errors.agree();
  posed.doubts = doubts_in(posed.drives, estimate, !moves);
  posed.disagreements = disagreements_in(posed.drives, estimate, !moves);
  posed.notes = notes_in(posed.drives, estimate, true);
  if (moves) {
    posed.counts = counts_of(estimate);
    posed.graph = drive_graph_of(estimate);
    const std::vector<maps::Drive> given = std::exchange(posed.drives, posed_by(estimate, drives));
    result.moved = moves_of(given, posed.drives, estimate);
  }
  posed.given = result;
  return posed;
}

PosedDrives with_estimated_poses(Build& build) {
  const std::vector<maps::Drive>& drives = build.shifted;
  const BuildTask& task = build.task;
  const TrajectoryEstimate estimate = estimate_trajectories(
      drives, options_of(task.options, task.odometry), task.scratch, task.progress, task.cancel);
  PosedDrives posed;
  posed.remarks = estimate.notes;
  posed.drives = posed_by(estimate, drives);
  posed.counts = counts_of(estimate);
  posed.graph = drive_graph_of(estimate);
  posed.doubts = doubts_in(drives, estimate, false);
  posed.disagreements = disagreements_in(drives, estimate, false);
  const bool asks_given = uses_given_poses(task.odometry, task.options);
  posed.notes = notes_in(drives, estimate, asks_given);
  if (asks_given) posed.faults = faults_in(build, estimate);
  return posed;
}

/// What `read` makes of a journal's one record; nothing where it is still to be found. A unit that
/// takes what another one found does not go on without.
/// @param read  throws std::invalid_argument for other bytes.
template <typename Read>
auto journaled(BuildJournal& journal, const BuildTask& task, const Read& read)
    -> std::optional<decltype(read(std::string()))> {
  constexpr std::string_view kUnit = "poses";
  const bool is_taken = task.poses_journal == BuildJournal::Use::kRead;
  std::optional<std::string> bytes;
  if (is_taken)
    bytes = journal.require(0, kUnit);
  else if (journal.is_complete())
    bytes = journal.read(0);
  try {
    if (bytes) return read(*bytes);
  } catch (const std::invalid_argument& error) {
    if (is_taken)
      throw maps::InputError(
          journal.file().string(), error.what(),
          fmt::format("what the unit '{0}' wrote: remove the file and do --unit {0} again", kUnit));
    journal.discard(error.what());
  }
  journal.keep(0);
  return std::nullopt;
}

/// What motion says of the clocks, or a killed build had found.
std::vector<double> journaled_offsets_s(Build& build) {
  const BuildTask& task = build.task;
  BuildJournal journal(task.journal_folder, "pose_time_offset",
                       trajectory_key(task.drives, task.options, "pose time offset"),
                       task.poses_journal);
  const auto known = journaled(journal, task, [&](const std::string& bytes) {
    std::istringstream stream(bytes);
    std::vector<double> offsets_s{std::istream_iterator<double>(stream), {}};
    if (offsets_s.size() != task.drives.size())
      throw std::invalid_argument("not one offset a drive");
    return offsets_s;
  });
  if (known) return *known;
  const StageTimer timer(build.result.stage_seconds, "pose time offset");
  std::vector<double> offsets_s = found_pose_time_offsets(task);
  journal.append(fmt::format("{}", fmt::join(offsets_s, " ")));
  journal.complete();
  return offsets_s;
}

/// Poses of all drives in one frame, or those that a killed build had found.
PosedDrives journaled_poses(Build& build) {
  const BuildTask& task = build.task;
  BuildJournal journal(task.journal_folder, "trajectory",
                       trajectory_key(build.shifted, task.options, task.odometry),
                       task.poses_journal);
  auto known = journaled(journal, task, [&](const std::string& bytes) {
    return posed_drives_from(bytes, build.shifted);
  });
  if (known) return *std::move(known);
  warn_of_discarded(journal, build.result);
  const StageTimer timer(build.result.stage_seconds, "trajectory");
  PosedDrives posed =
      task.odometry == "given" ? with_given_poses(build) : with_estimated_poses(build);
  journal.append(to_bytes(posed));
  journal.complete();
  return posed;
}

Eigen::Vector3d origin_of(const DriveSet& drives, const std::optional<BuildFrame>& frame) {
  if (frame) return frame->origin;
  return map_origin_near(drives.T_map_scan(0).translation());
}

/// One a pose of the map.
std::vector<maps::PoseDisagreement> of_poses(
    const DriveSet& drives, const std::vector<std::vector<maps::PoseDisagreement>>& of_drives) {
  std::vector<maps::PoseDisagreement> found(drives.size());
  for (std::size_t scan = 0; scan < found.size() && !of_drives.empty(); ++scan)
    found[scan] = of_drives.at(drives.place(scan).drive).at(drives.place(scan).index);
  return found;
}

/// Neighbouring scans that disagree by more than a voxel.
std::size_t neighbours_apart(const GivenPosesResult& given, double voxel_size_m) {
  return static_cast<std::size_t>(std::ranges::count_if(
      given.errors.neighbours_m, [&](double apart_m) { return apart_m > voxel_size_m; }));
}

}  // namespace

void shift_poses(Build& build) {
  const BuildTask& task = build.task;
  build.shifted = task.drives;
  if (!task.options.finds_pose_time_offset || !uses_given_poses(task.odometry, task.options))
    return;
  const std::vector<double> offsets_s = journaled_offsets_s(build);
  build.shifted = shifted_by(offsets_s, task.folders, task.drives, task.options);
  build.result.found_pose_time_offsets_s = offsets_s;
}

void find_poses(Build& build) {
  build.posed = journaled_poses(build);
  std::ranges::copy(build.posed.remarks, std::back_inserter(build.result.notes));
  build.result.trajectory = build.posed.counts;
  build.result.given_poses = build.posed.given;
  build.result.pose_faults = build.posed.faults;
  if (auto& given = build.result.given_poses)
    given->neighbours_apart = neighbours_apart(*given, build.task.options.voxel_size_m);
  warn_of_useless_offset(build);
  warn_of_found_offsets(build);
  warn_of_given_poses(build);
  warn_of_pose_faults(build);
}

namespace {

/// What was in doubt between the drives' own scans was found again in the map.
void trust_what_the_map_knows(const std::vector<std::vector<bool>>& known, PosedDrives& posed) {
  constexpr maps::PoseDisagreement kFound{0.02F, 0.001F};
  for (std::size_t drive = 0; drive < std::min(known.size(), posed.doubts.size()); ++drive) {
    std::vector<maps::PoseDisagreement>& doubts = posed.doubts[drive];
    for (std::size_t scan = 0; scan < std::min(doubts.size(), known[drive].size()); ++scan)
      if (known[drive][scan]) doubts[scan] = kFound;
  }
}

/// Moves the poses, or takes what a killed build had found.
BuildFrame journaled_registration(Build& build) {
  const BuildTask& task = build.task;
  BuildJournal journal(task.journal_folder, "registered", registered_key(build),
                       task.poses_journal);
  auto known = journaled(journal, task, [&](const std::string& bytes) {
    return registered_poses_from(bytes, build.shifted);
  });
  if (known) {
    build.posed = std::move(known->posed);
    return std::move(known->frame);
  }
  const StageTimer timer(build.result.stage_seconds, "register");
  RegisteredDrives registered = registered_to(
      *task.options.register_to, {build.posed.drives, build.posed.notes, task.odometry},
      task.options, task.progress, task.cancel);
  build.posed.drives = std::move(registered.drives);
  trust_what_the_map_knows(registered.known_by_map, build.posed);
  journal.append(to_bytes(build.posed, registered.frame));
  journal.complete();
  return std::move(registered.frame);
}

}  // namespace

void register_poses(Build& build) {
  if (!build.task.options.register_to) return;
  build.frame = journaled_registration(build);
  build.result.registration = build.frame->registration;
}

void select_scans(Build& build) {
  PosedDrives& posed = build.posed;
  build.drives.emplace(std::move(posed.drives), build.task.options, std::move(posed.doubts),
                       std::move(posed.notes));
  build.result.scans = build.drives->size();
  build.grid.emplace(origin_of(*build.drives, build.frame), build.task.options.voxel_size_m);
  build.disagreements = of_poses(*build.drives, posed.disagreements);
  warn_of_hidden_scans(build);
  warn_of_bent_places(build);
}

}  // namespace stillmap::mapping
