#include <stillmap/mapping/odometry.hpp>
#include <stillmap/mapping/odometry_evaluation.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/trajectory.hpp>

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "command_line/command_text.hpp"
#include "command_line/option_value.hpp"
#include "command_line/progress_bar.hpp"
#include "command_line/result_output.hpp"
#include "command_line/run_program.hpp"
#include "command_line/table.hpp"
#include "evaluate/commands.hpp"
#include "evaluate/work_folder.hpp"

namespace stillmap::evaluate {
namespace {

using command_line::grouped;
using mapping::OdometryEvaluation;
using mapping::TrajectoryErrors;

struct OdometryArguments {
  std::filesystem::path drive;
  std::optional<std::filesystem::path> poses;
  std::string select = "::";
  std::string loops = "on";
  std::string movable = "keep";
  std::optional<std::filesystem::path> trajectory;
  command_line::JsonOutput json;
  command_line::ReportOutput report;
  mapping::OdometryEvaluationOptions options;
};

void print_errors(const OdometryEvaluation& result) {
  constexpr const char* kRow = "{:<16}{:>11}{:>13}{:>10}{:>10}{:>16}{:>10}{:>12}\n";
  fmt::print("\n");
  fmt::print(fmt::runtime(kRow), "", "KITTI [%]", "[deg/100 m]", "APE [m]", "ATE [m]",
             "from start [m]", "10 m [%]", "10 m [deg]");
  const auto print = [&](const char* name, const TrajectoryErrors& errors) {
    fmt::print(fmt::runtime(kRow), name,
               command_line::number_text(errors.kitti.translation_percent, 3),
               command_line::number_text(errors.kitti.rotation_deg_per_100m, 4),
               command_line::number_text(errors.aligned_m.mean, 3),
               command_line::number_text(errors.aligned_m.rmse, 3),
               command_line::number_text(errors.from_start_m.rmse, 3),
               command_line::number_text(errors.relative.translation_percent_10m, 3),
               command_line::number_text(errors.relative.rotation_deg_10m, 4));
  };
  print("odometry alone", result.odometry);
  if (result.corrected) print("with loops", *result.corrected);
  fmt::print(
      "\nAPE (mean) and ATE (root mean square) after the best rigid motion without scale; from "
      "start: root mean\nsquare with nothing but the first poses in common. -: the drive is "
      "shorter than a segment.\n");
}

std::string text_of(const mapping::LoopScores& loops) {
  std::string text = loops.found == 0 ? std::string("none")
                                      : fmt::format("{}, right {} ({:.1f} %)", grouped(loops.found),
                                                    grouped(loops.right), 100.0 * loops.precision);
  if (loops.revisits == 0) return text + "; no place was driven again";
  return fmt::format("{}; {} of {} key frames at places driven before ({:.1f} %)", text,
                     grouped(loops.revisits_found), grouped(loops.revisits), 100.0 * loops.recall);
}

void print_for_people(const OdometryEvaluation& result) {
  command_line::Table table;
  table.add("scans", fmt::format("{}, {:.0f} m, in {:.1f} s", grouped(result.scans),
                                 result.odometry.way_m, result.seconds));
  if (result.odometry.poses != result.scans)
    table.add("compared", fmt::format("{} with a true pose", grouped(result.odometry.poses)));
  table.add("odometry", fmt::format("{:.1f} scans/s, reading included", result.scans_per_second));
  table.add("matched", fmt::format("{}, partly {}, predicted {}", grouped(result.matched),
                                   grouped(result.partly), grouped(result.predicted)));
  const auto hidden = std::ranges::count_if(result.path, &mapping::FollowedScan::hidden);
  if (hidden > 0)
    table.add("hidden", fmt::format("{} scans that show nothing of what those around them show",
                                    grouped(static_cast<std::size_t>(hidden))));
  const auto anew = std::ranges::find_if(result.path, &mapping::FollowedScan::begins_anew);
  if (anew != result.path.end())
    table.add("restarted", fmt::format("at scan {}: the motion before it is a guess", anew->scan));
  if (result.options.movable != mapping::MovablePolicy::kKeep)
    table.add("points",
              fmt::format("{}, projected {}, deleted {}", grouped(result.points.in),
                          grouped(result.points.projected), grouped(result.points.deleted)));
  if (result.loops) {
    table.add("loops", text_of(*result.loops));
    table.add("key frames", fmt::format("{}, loops in {:.1f} s, pose graph in {:.2f} s",
                                        grouped(result.keyframes.size()), result.loop_seconds,
                                        result.graph_seconds));
  }
  for (const std::string& note : result.notes) table.add("note", note);
  table.print();
  print_errors(result);
}

std::string to_json_text(const OdometryEvaluation& result, const OdometryArguments& arguments) {
  auto json = nlohmann::ordered_json::parse(mapping::to_json(result));
  json["version"] = STILLMAP_VERSION;
  json["options"]["drive"] = arguments.drive.string();
  json["options"]["select"] = arguments.select;
  json["options"]["poses"] = arguments.poses ? nlohmann::ordered_json(arguments.poses->string())
                                             : nlohmann::ordered_json(nullptr);
  return json.dump(2);
}

maps::Trajectory trajectory_of(const OdometryEvaluation& result) {
  std::vector<maps::StampedPose> poses;
  for (const mapping::FollowedScan& scan : result.path)
    poses.push_back({scan.stamp_ns, result.pose(scan)});
  return maps::Trajectory(std::move(poses));
}

/// The drive, with poses to compare with.
maps::Drive open_drive(OdometryArguments& arguments) {
  if (!arguments.poses) return maps::Drive::open(arguments.drive);
  maps::Drive own = maps::Drive::open(arguments.drive);
  auto reference = maps::poses_of_some_scans(own, *arguments.poses);
  if (!reference) return maps::Drive::open(arguments.drive, arguments.poses);
  arguments.options.reference = std::move(*reference);
  return own;
}

void evaluate(OdometryArguments& arguments, const CLI::App& command) {
  mapping::OdometryEvaluationOptions& options = arguments.options;
  options.selection = maps::Selection::parse(arguments.select);
  options.loops = arguments.loops == "on";
  options.movable = mapping::movable_policy_from(arguments.movable);
  if (command.count("--detector") > 0 && options.movable == mapping::MovablePolicy::kKeep)
    throw std::invalid_argument(
        "--detector has no effect with --movable keep; leave it out, or give --movable project or "
        "delete");
  const maps::Drive drive = open_drive(arguments);
  OdometryEvaluation result;
  {
    const WorkFolder scratch;
    command_line::ProgressBar bar;
    result = mapping::evaluate_odometry(
        drive, options, scratch.path(),
        [&bar](std::string_view stage, std::size_t done, std::size_t total) {
          bar.update(stage, done, total);
        },
        command_line::cancel_flag());
  }
  if (!arguments.json.replaces_text()) print_for_people(result);
  if (arguments.trajectory)
    maps::write_tum_trajectory(*arguments.trajectory, trajectory_of(result));
  if (arguments.report.is_asked()) {
    arguments.report.write(mapping::to_html(result, {.drive = arguments.drive.string(),
                                                     .command = command_line::command_of(command)}),
                           arguments.json);
  }
  if (arguments.json.is_asked()) arguments.json.write(to_json_text(result, arguments));
}

void add_outputs(CLI::App& command, OdometryArguments& arguments) {
  command
      .add_option("--trajectory", arguments.trajectory,
                  "Write the estimated path to FILE (TUM), in the frame of its first scan")
      ->check(command_line::in_existing_folder());
  arguments.json.add_to(command);
  arguments.report.add_to(command);
}

}  // namespace

void add_odometry(CLI::App& evaluate_command) {
  auto arguments = std::make_shared<OdometryArguments>();
  mapping::OdometryEvaluationOptions& options = arguments->options;
  CLI::App* command = evaluate_command.add_subcommand(
      "odometry",
      "Estimate a drive's path by odometry and compare it with the drive's poses: KITTI's metric, "
      "ATE, RPE, loops");
  command
      ->add_option("DRIVE", arguments->drive, "Drive with poses, or without them and with --poses")
      ->required()
      ->check(command_line::existing_drive());
  command->add_option("--odometry", options.method, "Odometry method")
      ->capture_default_str()
      ->check(command_line::one_of(mapping::odometry_names()));
  command
      ->add_option("--loops", arguments->loops,
                   "on: also close loops where a place was driven again; off: odometry alone")
      ->capture_default_str()
      ->check(command_line::one_of({"on", "off"}));
  command
      ->add_option("--poses", arguments->poses,
                   "True poses to use instead of the drive's own: KITTI, TUM, CSV or g2o, "
                   "T_map_lidar. Where a "
                   "TUM file has poses of some scans only, only these scans are judged")
      ->check(command_line::existing_path());
  command->add_option("--select", arguments->select, "Scans to use, begin:end as in Python")
      ->capture_default_str();
  command
      ->add_option(
          "--movable", arguments->movable,
          "What happens to points of movable objects before odometry, in each scan on its "
          "own as in the paper: keep, project (to the scan's mean ground height) or delete")
      ->capture_default_str()
      ->check(command_line::one_of({"keep", "project", "delete"}));
  command->add_option("--detector", options.detector, "Detector for --movable, named as for build")
      ->capture_default_str();
  command
      ->add_option("--threads", options.threads,
                   "Threads; 0 = all cores. The path is the same with any number")
      ->capture_default_str();
  add_outputs(*command, *arguments);
  command->callback([arguments, command] { evaluate(*arguments, *command); });
}

}  // namespace stillmap::evaluate
