#include "rebuild/held_back.hpp"

#include "pipeline/opened_drives.hpp"
#include "trajectory/common_frame.hpp"
#include "trajectory/drive_of_map.hpp"

#include <stillmap/localization/aligner.hpp>
#include <stillmap/mapping/localization_evaluation.hpp>

#include <fmt/format.h>
#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <cmath>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <utility>

namespace stillmap::mapping {
namespace {

/// A scan farther from where the map was made from sees little of it, in any of the maps.
constexpr double kNearM = 10.0;

/// Whether the map stands in the frame of the drives' own poses.
bool is_in_own_frame(const std::vector<maps::Drive>& drives, const MapBuildOptions& options) {
  return uses_given_poses(odometry_of(drives, options), options);
}

maps::Drive moved_by(const Eigen::Isometry3d& T, const maps::Drive& drive) {
  std::vector<Eigen::Isometry3d> poses = drive.contents().T_map_lidar;
  for (Eigen::Isometry3d& pose : poses) pose = T * pose;
  return drive.with_poses(std::move(poses), std::nullopt);
}

bool is_near(const Eigen::Isometry3d& pose, const std::vector<maps::Trajectory>& paths) {
  for (const maps::Trajectory& path : paths) {
    for (const maps::StampedPose& each : path.poses()) {
      if ((each.T_map_lidar.translation() - pose.translation()).norm() <= kNearM) return true;
    }
  }
  return false;
}

void thin_out(std::vector<HeldBackDrive>& drives) {
  std::size_t all = 0;
  for (const HeldBackDrive& each : drives) all += each.scans.size();
  if (all <= kMostHeldBackScans) return;
  std::size_t number = 0;
  for (HeldBackDrive& each : drives) {
    std::erase_if(each.scans, [&](std::size_t) {
      // Of each step of all / most, the first.
      const std::size_t slot = number * kMostHeldBackScans / all;
      const bool first = number == 0 || (number - 1) * kMostHeldBackScans / all != slot;
      ++number;
      return !first;
    });
  }
}

HeldBackDrive another_drive(const RebuildOptions& options, const std::vector<maps::Drive>& own,
                            const maps::MapPackage& map,
                            const std::vector<maps::Trajectory>& paths) {
  const maps::Drive drive = held_back_drive(options);
  // Refined, or with a prior or GNSS, every pose moved a little of its own, and all by
  // registration.
  const auto& registration = map.manifest().registration;
  const Eigen::Isometry3d T_map_first =
      registration ? registration->T_map_poses : Eigen::Isometry3d::Identity();
  HeldBackDrive out{moved_by(T_map_first * T_first_own(own.front(), drive), drive), {}};
  for (std::size_t scan = 0; scan < out.drive.size(); ++scan) {
    if (is_near(out.drive.T_map_lidar(scan), paths)) out.scans.push_back(scan);
  }
  return out;
}

void add_answers(const LocalizationEvaluation& evaluation, HeldBackAnswers& answers) {
  const LocalizationLevel& level = evaluation.levels.front();
  const auto count = [&](double rate) {
    return static_cast<std::size_t>(std::llround(rate * static_cast<double>(level.queries)));
  };
  answers.queries += level.queries;
  answers.found += count(level.success_rate);
  answers.false_ok += count(level.false_ok_rate);
  answers.ok += level.ok;
  answers.degraded += level.degraded;
  answers.lost += level.lost;
  for (const LocalizationQuery& query : evaluation.queries.front())
    answers.status += localization::name_of(query.status).front();
}

}  // namespace

maps::Drive held_back_drive(const RebuildOptions& options) {
  maps::Drive drive = maps::Drive::open(*options.held_back, std::nullopt,
                                        std::llround(1e9 * options.build.pose_time_offset_s));
  if (!options.build.geodetic_origin || !drive.has_poses() || drive.contents().origin) return drive;
  return drive.with_poses(drive.contents().T_map_lidar, options.build.geodetic_origin);
}

void require_comparable(const RebuildOptions& options) {
  if (!options.held_back) return;
  const maps::Drive drive = held_back_drive(options);
  const std::string name = options.held_back->string();
  if (!drive.has_poses())
    throw maps::InputError(name, "a drive without poses",
                           "poses in the frame of the map's drives: hold back another drive, or "
                           "leave out --held-back");
  const std::vector<maps::Drive> own = open_drives(options.drives, options.build);
  if (!is_in_own_frame(own, options.build))
    throw maps::InputError(
        name, "poses of its own beside a map whose poses are estimated",
        "drives with poses, or scans held back from the drives themselves: leave out --held-back");
  (void)T_first_own(own.front(), drive);
}

std::vector<HeldBackDrive> held_back_drives(const RebuildOptions& options,
                                            const maps::MapPackage& map) {
  const std::vector<maps::Drive> own = open_drives(options.drives, options.build);
  const std::vector<maps::Trajectory> paths = map.trajectories();
  if (paths.size() != own.size())
    throw maps::InputError(map.folder().string(), fmt::format("{} paths", paths.size()),
                           fmt::format("one for each of {} drives", own.size()));
  std::vector<HeldBackDrive> drives;
  if (options.held_back) {
    drives.push_back(another_drive(options, own, map, paths));
  } else {
    for (std::size_t i = 0; i < own.size(); ++i)
      drives.push_back({on_path(own[i], paths[i]), options.build.held_back_of(own[i].size())});
  }
  thin_out(drives);
  return drives;
}

Eigen::Isometry3d T_to_from(const maps::MapPackage& to, const maps::MapPackage& from) {
  const auto first = [](const maps::MapPackage& map) {
    const std::vector<maps::Trajectory> paths = map.trajectories();
    if (paths.empty() || paths.front().empty())
      throw maps::InputError(map.folder().string(), "no path", "the path that it was made from");
    return paths.front().poses().front().T_map_lidar;
  };
  return first(to) * first(from).inverse();
}

HeldBackAnswers ask_for(const std::vector<HeldBackDrive>& drives, const maps::MapPackage& map,
                        const Eigen::Isometry3d& T_this_map, int threads,
                        const ProgressCallback& progress, const CancelFlag& cancel) {
  HeldBackAnswers answers;
  std::size_t all = 0;
  for (const HeldBackDrive& each : drives) all += each.scans.size();
  for (const HeldBackDrive& each : drives) {
    if (each.scans.empty()) continue;
    LocalizationEvaluationOptions options;
    options.prior_errors = {{.metres = kGatePriorErrorM, .degrees = kGatePriorErrorDeg}};
    options.seed = kGateSeed;
    options.threads = threads;
    options.reference.resize(each.drive.size());
    for (const std::size_t scan : each.scans)
      options.reference[scan] = T_this_map * each.drive.T_map_lidar(scan);
    const std::size_t before = answers.queries;
    add_answers(evaluate_localization(
                    map, each.drive, options,
                    [](const maps::MapPackage& package) {
                      return localization::make_aligner("default", package);
                    },
                    [&](std::string_view stage, std::size_t done, std::size_t) {
                      if (progress) progress(stage, before + done, all);
                    },
                    cancel),
                answers);
  }
  return answers;
}

std::string text_of(const HeldBackAnswers& answers) {
  return fmt::format("{} {} {} {} {} {} {}", answers.queries, answers.found, answers.ok,
                     answers.degraded, answers.lost, answers.false_ok, answers.status);
}

HeldBackAnswers answers_from(const std::string& text) {
  HeldBackAnswers answers;
  std::istringstream stream(text);
  stream >> answers.queries >> answers.found >> answers.ok >> answers.degraded >> answers.lost >>
      answers.false_ok;
  const bool numbers = !stream.fail();
  // Empty where no scan was asked for.
  stream >> answers.status;
  if (!numbers || answers.status.size() != answers.queries)
    throw std::invalid_argument("answers: found '" + text + "'");
  return answers;
}

}  // namespace stillmap::mapping
