#include <stillmap/mapping/odometry_evaluation.hpp>

#include "core/seconds_since.hpp"
#include "evaluation/odometry/loop_scores.hpp"
#include "evaluation/odometry/trajectory_errors.hpp"
#include "evaluation/odometry/treated_scans.hpp"
#include "odometry/imu_clock.hpp"

#include <fmt/format.h>
#include <stillmap/mapping/trajectory.hpp>
#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <chrono>
#include <map>
#include <stdexcept>
#include <utility>

namespace stillmap::mapping {
namespace {

using Clock = std::chrono::steady_clock;

std::optional<Eigen::Isometry3d> truth_of(const maps::Drive& drive,
                                          const OdometryEvaluationOptions& options,
                                          std::size_t scan) {
  if (!options.reference.empty()) return options.reference.at(scan);
  return drive.T_map_lidar(scan);
}

void check(const maps::Drive& drive, const OdometryEvaluationOptions& options,
           const std::vector<std::size_t>& scans) {
  if (const auto broken = options.violations(); !broken.empty())
    throw std::invalid_argument("odometry evaluation: " + broken.front());
  const std::string folder = drive.contents().root.string();
  if (options.reference.empty() ? !drive.has_poses() : options.reference.size() != drive.size()) {
    throw maps::InputError(folder, "a drive without poses to compare with",
                           "poses: give --poses FILE");
  }
  const auto judged = std::count_if(scans.begin(), scans.end(), [&](std::size_t scan) {
    return truth_of(drive, options, scan).has_value();
  });
  if (judged < 2)
    throw maps::InputError(
        folder, fmt::format("{} selected scans, {} of them with a pose", scans.size(), judged),
        "at least two to compare: change --select");
}

std::vector<FollowedScan> path_of(const maps::Drive& drive,
                                  const OdometryEvaluationOptions& options,
                                  const EstimatedDrive& estimated) {
  std::vector<FollowedScan> path;
  for (std::size_t i = 0; i < estimated.odometry.size(); ++i) {
    const std::size_t scan = estimated.begin + i;
    path.push_back({.scan = scan,
                    .stamp_ns = drive.stamp_ns(scan),
                    .status = estimated.odometry[i].status,
                    .hidden = estimated.odometry[i].hidden,
                    .begins_anew = estimated.odometry[i].begins_anew,
                    .T_odom_lidar = estimated.odometry[i].T_odom_lidar,
                    .T_map_lidar = estimated.T_map_lidar.at(i),
                    .T_truth_lidar = truth_of(drive, options, scan)});
  }
  return path;
}

std::size_t count_of(const std::vector<FollowedScan>& path, OdometryStatus status) {
  return static_cast<std::size_t>(std::count_if(
      path.begin(), path.end(), [&](const FollowedScan& scan) { return scan.status == status; }));
}

/// Scans with a true pose alone.
struct JudgedPaths {
  explicit JudgedPaths(const std::vector<FollowedScan>& path) {
    for (const FollowedScan& scan : path) {
      if (!scan.T_truth_lidar) continue;
      truth.push_back(*scan.T_truth_lidar);
      odometry.push_back(scan.T_odom_lidar);
      corrected.push_back(scan.T_map_lidar);
    }
  }
  std::vector<Eigen::Isometry3d> truth, odometry, corrected;
};

/// Loops between key frames with a true pose, numbered by these.
LoopScores loops_of(const OdometryEvaluation& evaluation, const TrajectoryEstimate& estimate) {
  std::vector<Eigen::Isometry3d> path;
  std::vector<double> way_m;
  std::map<std::size_t, std::size_t> number_of_scan;
  std::size_t next = 0;
  double way = 0.0;
  const FollowedScan* before = nullptr;
  for (std::size_t i = 0; i < evaluation.path.size(); ++i) {
    const FollowedScan& scan = evaluation.path[i];
    const bool is_keyframe = next < evaluation.keyframes.size() && evaluation.keyframes[next] == i;
    next += is_keyframe ? 1 : 0;
    if (!scan.T_truth_lidar) continue;
    if (before != nullptr)
      way += (scan.T_truth_lidar->translation() - before->T_truth_lidar->translation()).norm();
    before = &scan;
    if (!is_keyframe) continue;
    number_of_scan[scan.scan] = path.size();
    path.push_back(*scan.T_truth_lidar);
    way_m.push_back(way);
  }
  std::vector<EvaluatedLoop> loops;
  for (const EstimatedLoop& loop : estimate.loops) {
    const auto from = number_of_scan.find(loop.from_scan);
    const auto to = number_of_scan.find(loop.to_scan);
    if (from == number_of_scan.end() || to == number_of_scan.end()) continue;
    loops.push_back({.from = from->second,
                     .to = to->second,
                     .from_scan = loop.from_scan,
                     .to_scan = loop.to_scan,
                     .T_from_to = loop.T_from_to,
                     .weight = loop.weight});
  }
  return score_loops(path, way_m, loops);
}

}  // namespace

std::vector<std::string> OdometryEvaluationOptions::violations() const {
  std::vector<std::string> broken;
  if (selection.step != 1)
    broken.push_back(
        fmt::format("selection: step {}, 1: odometry needs every scan", selection.step));
  const std::vector<std::string> methods = odometry_names();
  if (std::find(methods.begin(), methods.end(), method) == methods.end())
    broken.push_back(fmt::format("method: {}, one of {}", method, fmt::join(methods, ", ")));
  if (threads < 0 || threads > 256)
    broken.push_back(fmt::format("threads: {}, in [0, 256]", threads));
  return broken;
}

OdometryEvaluation evaluate_odometry(const maps::Drive& given,
                                     const OdometryEvaluationOptions& options,
                                     const std::filesystem::path& scratch,
                                     const ProgressCallback& progress, const CancelFlag& cancel) {
  const Clock::time_point began = Clock::now();
  const std::vector<std::size_t> scans = options.selection.indices(given.size());
  check(given, options, scans);
  const maps::Drive drive = with_fitted_imu(given, options.threads, progress, cancel);
  const TreatedScans treated(drive, options.movable, options.detector, scans, cancel);
  TrajectoryOptions trajectory;
  trajectory.odometry = options.method;
  trajectory.loops = options.loops;
  trajectory.begin = scans.front();
  trajectory.end = scans.back() + 1;
  trajectory.threads = options.threads;
  const TrajectoryEstimate estimate = estimate_trajectories(
      {drive}, trajectory, scratch, progress, cancel,
      [&](const maps::Drive&, std::size_t scan) { return treated.read(scan); });

  OdometryEvaluation evaluation;
  evaluation.options = options;
  evaluation.scans = scans.size();
  evaluation.notes = drive.contents().notes;
  evaluation.notes.insert(evaluation.notes.end(), estimate.notes.begin(), estimate.notes.end());
  evaluation.odometry_seconds = estimate.odometry_seconds;
  evaluation.loop_seconds = estimate.loop_seconds;
  evaluation.graph_seconds = estimate.graph_seconds;
  evaluation.scans_per_second =
      static_cast<double>(scans.size()) / std::max(estimate.odometry_seconds, 1e-9);
  evaluation.points = treated.points();
  const EstimatedDrive& estimated = estimate.drives.at(0);
  evaluation.path = path_of(drive, options, estimated);
  evaluation.matched = count_of(evaluation.path, OdometryStatus::kMatched);
  evaluation.partly = count_of(evaluation.path, OdometryStatus::kPartly);
  evaluation.predicted = count_of(evaluation.path, OdometryStatus::kPredicted);
  for (const std::size_t scan : estimated.keyframes)
    evaluation.keyframes.push_back(scan - estimated.begin);
  const JudgedPaths judged(evaluation.path);
  evaluation.odometry = trajectory_errors(judged.truth, judged.odometry);
  if (options.loops) {
    evaluation.corrected = trajectory_errors(judged.truth, judged.corrected);
    evaluation.loops = loops_of(evaluation, estimate);
  }
  evaluation.seconds = seconds_since(began);
  return evaluation;
}

}  // namespace stillmap::mapping
