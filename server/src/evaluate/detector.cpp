#include <stillmap/mapping/detector_evaluation.hpp>
#include <stillmap/maps/drive.hpp>

#include <fmt/core.h>

#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "command_line/command_text.hpp"
#include "command_line/progress_bar.hpp"
#include "command_line/result_output.hpp"
#include "command_line/run_program.hpp"
#include "command_line/table.hpp"
#include "evaluate/commands.hpp"

namespace stillmap::evaluate {
namespace {

using command_line::grouped;
using mapping::DetectorEvaluation;
using mapping::Share;

struct DetectorArguments {
  std::filesystem::path drive;
  std::string select = "::";
  command_line::JsonOutput json;
  command_line::ReportOutput report;
  mapping::DetectorEvaluationOptions options;
};

std::string counted(const Share& share) {
  if (share.of == 0) return "none to count";
  return fmt::format("{} of {} ({})", grouped(share.count), grouped(share.of),
                     command_line::percent_text(share.rate(), 1));
}

std::string by_track(const mapping::CentreRecall& recall) {
  if (recall.found.of == 0) return "none to count";
  return fmt::format("{}, {} tracks {}", counted(recall.found), recall.tracks.size(),
                     command_line::percent_text(recall.by_track(), 1));
}

/// Inside of the boxes, and of those that a build grows.
void add_points(command_line::Table& table, const DetectorEvaluation& result) {
  const mapping::PointDetection& plain = *result.points;
  const mapping::PointDetection& built = *result.points_as_built;
  const auto add = [&](const std::string& name, const Share& inside, const Share& grown) {
    table.add(name,
              fmt::format("{}; boxes grown by {:g} m {}", counted(inside), result.build_margin_m,
                          command_line::percent_text(grown.rate(), 1)));
  };
  add("movable points inside of boxes", plain.movable, built.movable);
  for (std::size_t i = 0; i < plain.classes.size(); ++i) {
    if (plain.classes[i].movable)
      add("  " + plain.classes[i].name, plain.classes[i].inside, built.classes[i].inside);
  }
  add("static points inside of boxes", plain.stays, built.stays);
  add("  without detected ground", plain.stays_above_ground, built.stays_above_ground);
}

void print_boxes(const mapping::BoxDetection& boxes) {
  fmt::print("\n{:<14}{:>9}{:>9}{:>9}{:>28}{:>42}\n", "", "AP 0.3", "AP 0.5", "AP 0.7",
             "found within 1.5 m", "50 points within 40 m, by track");
  for (const mapping::ClassDetection& each : boxes.classes) {
    fmt::print("{:<14}", each.name);
    for (std::size_t i = 0; i < 3; ++i) {
      const bool asked = i < each.average_precision.size();
      fmt::print("{:>9}",
                 asked ? command_line::percent_text(each.average_precision[i].value, 1) : "");
    }
    fmt::print("{:>28}{:>42}\n", counted(each.all.found), by_track(each.well_seen));
  }
  fmt::print("\n{:<14}{:>28}{:>9}{:>16}\n", "vehicles", "found within 1.5 m", "AP 0.5",
             "false a scan");
  for (const mapping::DistanceDetection& band : boxes.distances) {
    fmt::print("{:<14}{:>28}{:>9}{:>16.2f}\n",
               fmt::format("{:g} to {:g} m", band.from_m, band.to_m), counted(band.found),
               command_line::percent_text(band.average_precision, 1), band.false_boxes_per_scan);
  }
  for (const mapping::VisibilityDetection& each : boxes.visibilities) {
    fmt::print("{:<14}{:>28}{:>9}\n", fmt::format("{}+ points", each.min_points),
               counted(each.found), command_line::percent_text(each.average_precision, 1));
  }
}

void print_for_people(const DetectorEvaluation& result) {
  command_line::Table table;
  table.add("scans", fmt::format("{} in {:.1f} s", result.scans, result.seconds));
  table.add("time a scan", fmt::format("{:.1f} ms, ground before it {:.1f} ms", result.detect_ms,
                                       result.ground_ms));
  if (result.boxes) {
    const mapping::BoxDetection& boxes = *result.boxes;
    table.add("labels", boxes.source + (boxes.in_camera_only ? ", camera's view only" : ""));
    table.add("false vehicle boxes",
              fmt::format("{:.2f} a scan, {} of {} boxes; {} more are not judged",
                          boxes.false_boxes_per_scan, grouped(boxes.false_vehicles),
                          grouped(boxes.boxes), grouped(boxes.ignored_vehicles)));
  }
  if (result.points) add_points(table, result);
  table.print();
  if (result.boxes) print_boxes(*result.boxes);
}

std::string to_json_text(const DetectorEvaluation& result, const DetectorArguments& arguments) {
  auto json = nlohmann::ordered_json::parse(mapping::to_json(result));
  json["version"] = STILLMAP_VERSION;
  json["options"]["drive"] = arguments.drive.string();
  json["options"]["select"] = arguments.select;
  return json.dump(2);
}

void evaluate(DetectorArguments& arguments, const CLI::App& command) {
  arguments.options.selection = maps::Selection::parse(arguments.select);
  const maps::Drive drive = maps::Drive::open(arguments.drive);
  DetectorEvaluation result;
  {
    command_line::ProgressBar bar;
    result = mapping::evaluate_detector(
        drive, arguments.options, arguments.report.is_asked(),
        [&bar](std::string_view stage, std::size_t done, std::size_t total) {
          bar.update(stage, done, total);
        },
        command_line::cancel_flag());
  }
  if (!arguments.json.replaces_text()) print_for_people(result);
  if (arguments.report.is_asked()) {
    arguments.report.write(mapping::to_html(result, {.drive = arguments.drive.string(),
                                                     .command = command_line::command_of(command)}),
                           arguments.json);
  }
  if (arguments.json.is_asked()) arguments.json.write(to_json_text(result, arguments));
}

}  // namespace

void add_detector(CLI::App& evaluate_command) {
  auto arguments = std::make_shared<DetectorArguments>();
  mapping::DetectorEvaluationOptions& options = arguments->options;
  CLI::App* command = evaluate_command.add_subcommand(
      "detector", "Compare the boxes that a detector finds with labelled boxes and points");
  command
      ->add_option("DRIVE", arguments->drive,
                   "Drive with labels: boxes.json, tracking/label_02.txt, label_2/ or labels/")
      ->required()
      ->check(command_line::existing_drive());
  command->add_option("--detector", options.detector, "Detector to judge, named as for build")
      ->capture_default_str();
  command
      ->add_option(
          "--boxes", options.boxes_file,
          "Labelled boxes to use instead of the drive's own: KITTI tracking (camera's view "
          "only) or JSON (format stillmap-boxes, all around)")
      ->check(command_line::existing_file());
  command->add_option("--select", arguments->select, "Scans to use, begin:end:step as in Python")
      ->capture_default_str();
  command
      ->add_option("--max-range", options.max_range_m,
                   "Boxes and points farther from the sensor do not count [m]")
      ->capture_default_str();
  arguments->json.add_to(*command);
  arguments->report.add_to(*command);
  command->callback([arguments, command] { evaluate(*arguments, *command); });
}

}  // namespace stillmap::evaluate
