#include <stillmap/mapping/label_evaluation.hpp>
#include <stillmap/mapping/map_consistency.hpp>
#include <stillmap/mapping/map_evaluation.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/map_package.hpp>

#include <fmt/core.h>

#include <cmath>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "command_line/command_text.hpp"
#include "command_line/consistency_rows.hpp"
#include "command_line/option_value.hpp"
#include "command_line/progress_bar.hpp"
#include "command_line/result_output.hpp"
#include "command_line/run_program.hpp"
#include "command_line/table.hpp"
#include "command_line/text_file.hpp"
#include "evaluate/commands.hpp"

namespace stillmap::evaluate {
namespace {

using command_line::grouped;
using mapping::LabelEvaluation;
using mapping::MapFigures;
using mapping::MapScores;
using mapping::Share;
using mapping::TruthClasses;

struct MapArguments {
  std::filesystem::path map;
  /// None: only what needs no truth is evaluated.
  std::optional<std::filesystem::path> drive;
  std::optional<std::filesystem::path> poses;
  std::optional<std::filesystem::path> boxes;
  std::optional<std::filesystem::path> pictures;
  command_line::JsonOutput json;
  command_line::ReportOutput report;
  TruthClasses classes = TruthClasses::kMovable;
};

std::string share(std::size_t part, std::size_t whole) {
  if (whole == 0) return "none to count";
  return fmt::format("{:.2f} %", 100.0 * static_cast<double>(part) / static_cast<double>(whole));
}

void print_for_people(const mapping::MapEvaluation& result) {
  command_line::Table table;
  table.add("labelled scans", fmt::format("{} in {:.1f} s", result.scans, result.seconds));
  table.add("points in boxes, above ground",
            fmt::format("{} before, {} after", grouped(result.box_points_before),
                        grouped(result.box_points_after)));
  table.add("  removed",
            share(result.box_points_before - result.box_points_after, result.box_points_before));
  table.add("points outside all boxes", grouped(result.outside_points));
  table.add("  changed", share(result.outside_changed, result.outside_points));
  table.add("  changed ahead, where labels are complete",
            share(result.fov_changed, result.fov_points));
  table.print();
}

/// With the number of what was counted.
std::string percent_of(const Share& share) {
  if (share.of == 0) return "none to count";
  return fmt::format("{} of {}", command_line::percent_text(share.rate(), 2), grouped(share.of));
}

void print_summary(const LabelEvaluation& result) {
  command_line::Table table;
  table.add("scans", fmt::format("{} in {:.1f} s", result.scans, result.seconds));
  table.add("labelled points",
            fmt::format("{}, {} of no known class, {} dropped by the build", grouped(result.points),
                        grouped(result.ignored), grouped(result.dropped)));
  if (!result.drive_in_map) {
    table.add("drive",
              "not in the map: its package is judged as it is, with all scans of the "
              "drive; what was out of the map's sight counts as lost");
  } else if (result.drives > 1) {
    table.add("drive", fmt::format("one of {} in the map; the others' points are those of the "
                                   "package",
                                   result.drives));
  }
  table.print();
}

/// A line of the table of scores: for both sets of classes on both kinds of map.
void print_scores_line(const LabelEvaluation& result, const std::string& name,
                       const std::function<std::string(const MapScores&)>& value) {
  fmt::print("{:<32}", name);
  for (const TruthClasses classes : {TruthClasses::kMovable, TruthClasses::kMoving}) {
    fmt::print("{:>12}", result.unthinned ? value(result.unthinned->of(classes)) : "-");
    fmt::print("{:>12}", value(result.thinned.of(classes)));
  }
  fmt::print("\n");
}

void print_scores(const LabelEvaluation& result) {
  fmt::print("\n{:<32}{:>12}{:>12}{:>12}{:>12}\n", "", "movable", "thinned", "moving", "thinned");
  const auto line = [&](const std::string& name, const auto& value) {
    print_scores_line(result, name, value);
  };
  line("SA", [](const MapScores& s) { return command_line::percent_text(s.SA, 2); });
  line("DA, projected not matched",
       [](const MapScores& s) { return command_line::percent_text(s.DA, 2); });
  line("DA, plain",
       [](const MapScores& s) { return command_line::percent_text(s.plain_removed.rate(), 2); });
  line("AA", [](const MapScores& s) { return command_line::percent_text(s.AA, 2); });
  line("HA", [](const MapScores& s) { return command_line::percent_text(s.HA, 2); });
  line("  static points", [](const MapScores& s) { return grouped(s.static_kept.of); });
  line("  dynamic points", [](const MapScores& s) { return grouped(s.dynamic_removed.of); });
  line("PR", [](const MapScores& s) { return command_line::percent_text(s.PR, 2); });
  line("RR", [](const MapScores& s) { return command_line::percent_text(s.RR, 2); });
  line("F1", [](const MapScores& s) { return command_line::percent_text(s.F1, 2); });
  line("  static voxels", [](const MapScores& s) { return grouped(s.static_voxels_kept.of); });
  line("  dynamic voxels", [](const MapScores& s) { return grouped(s.dynamic_voxels_kept.of); });
  line("static points lost",
       [](const MapScores& s) { return command_line::percent_text(s.static_lost.rate(), 3); });
  line("  with nothing removed", [](const MapScores& s) {
    return s.static_lost_uncleaned.of == 0
               ? std::string("0")
               : command_line::percent_text(s.static_lost_uncleaned.rate(), 3);
  });
  line("static loss",
       [](const MapScores& s) { return command_line::percent_text(s.static_loss, 3); });
  line("  of points", [](const MapScores& s) { return grouped(s.static_lost.of); });
  fmt::print(
      "movable: parked objects should be gone; moving: they should be there, and count as static\n"
      "thinned: the map package, one point for each voxel; left of it: every point that was "
      "kept\n");
}

void print_losses(const LabelEvaluation& result) {
  fmt::print("\n{:<32}{:>12}{:>12}{:>14}{:>14}\n", "static loss by class", "loss", "thinned",
             "points lost", "points");
  const std::vector<mapping::ClassLoss>& losses = result.figures().losses;
  for (std::size_t i = 0; i < losses.size(); ++i) {
    fmt::print("  {:<30}{:>12}{:>12}{:>14}{:>14}\n", losses[i].name,
               result.unthinned ? command_line::percent_text(losses[i].loss, 3) : "-",
               command_line::percent_text(result.thinned.losses.at(i).loss, 3),
               grouped(losses[i].lost.count), grouped(losses[i].lost.of));
  }
}

std::string text_of(const mapping::HeightErrors& errors) {
  if (errors.points == 0) return "none to count";
  return fmt::format("{:.1f} cm, 95 % below {:.1f} cm, of {} points", 100.0 * errors.median_m,
                     100.0 * errors.p95_m, grouped(errors.points));
}

void print_ground(const LabelEvaluation& result) {
  fmt::print("\n");
  command_line::Table table;
  const MapFigures& figures = result.figures();
  table.add("points of parked objects removed",
            result.true_ground == mapping::TrueGround::kNone
                ? "no true ground"
                : fmt::format("{}, thinned {}", percent_of(figures.parked_removed),
                              command_line::percent_text(result.thinned.parked_removed.rate(), 2)));
  if (result.heights) {
    const mapping::GroundUnder& under = figures.ground_under;
    table.add("ground under objects, projected", percent_of(under.projected) + " cells");
    table.add("  and filled", fmt::format("{} cells, {} at a wrong height",
                                          percent_of(under.filled), grouped(under.wrong)));
    for (const mapping::GroundUnderBand& band : figures.ground_bands) {
      table.add(std::isfinite(band.to_m) ? fmt::format("  up to {:g} m from the path", band.to_m)
                                         : std::string("  beyond"),
                fmt::format("{}, projected {}", percent_of(band.ground.filled),
                            command_line::percent_text(band.ground.projected.rate(), 2)));
    }
    table.add("height error of it, median", text_of(result.heights->all));
    table.add("  projected", text_of(result.heights->projected));
    table.add("  filled", text_of(result.heights->filled));
    table.add("  on one surface", text_of(result.heights->one_surface));
    table.add("  across a kerb", text_of(result.heights->across_kerb));
  } else {
    table.add("ground under objects", "no true ground");
  }
  if (result.ground) {
    table.add("ground points",
              fmt::format("precision {}, recall {}, F1 {}",
                          command_line::percent_text(result.ground->precision(), 2),
                          command_line::percent_text(result.ground->recall(), 2),
                          command_line::percent_text(result.ground->f1(), 2)));
  }
  table.print();
}

void print_for_people(const LabelEvaluation& result) {
  print_summary(result);
  print_scores(result);
  print_losses(result);
  print_ground(result);
}

/// @param text  the JSON object of the comparison with the truth.
std::string to_json_text(const std::string& text, const mapping::MapConsistency& consistency,
                         const MapArguments& arguments) {
  auto json = nlohmann::ordered_json::parse(text);
  json["consistency"] = nlohmann::ordered_json::parse(mapping::to_json(consistency));
  json["version"] = STILLMAP_VERSION;
  json["options"] = {{"map", arguments.map.string()}};
  if (arguments.drive) json["options"]["truth"] = arguments.drive->string();
  if (arguments.boxes) {
    json["options"]["boxes"] = arguments.boxes->string();
  } else if (arguments.drive) {
    json["options"]["truth_classes"] = name_of(arguments.classes);
  }
  if (arguments.poses) json["options"]["poses"] = arguments.poses->string();
  return json.dump(2);
}

void print_consistency(const mapping::MapConsistency& consistency) {
  command_line::Table table;
  command_line::add_consistency(table, consistency);
  table.print();
}

/// What is compared, with callbacks for the progress.
struct MapAndTruth {
  const maps::MapPackage& map;
  const maps::Drive& drive;
  mapping::ProgressCallback progress;
  /// Before anything else is printed.
  std::function<void()> end_progress;
};

/// Against labelled boxes.
/// @return the object of `--json`.
std::string evaluate_boxes(const MapArguments& arguments, const MapAndTruth& compared) {
  if (arguments.report.is_asked())
    throw std::invalid_argument(
        "--report: there is no report for --boxes, only for labelled points; leave out --report, "
        "or leave out --boxes if the drive's points are labelled");
  const mapping::MapEvaluation result =
      mapping::evaluate_map(compared.map, compared.drive, {*arguments.boxes, arguments.pictures},
                            compared.progress, command_line::cancel_flag());
  compared.end_progress();
  if (!arguments.json.replaces_text()) print_for_people(result);
  return mapping::to_json(result);
}

/// Against labelled points.
/// @return the object of `--json`.
std::string evaluate_points(const MapArguments& arguments, const CLI::App& command,
                            const MapAndTruth& compared) {
  const bool draw = arguments.report.is_asked() || arguments.pictures;
  const LabelEvaluation result = mapping::evaluate_with_labels(
      compared.map, compared.drive, draw, compared.progress, command_line::cancel_flag());
  compared.end_progress();
  if (!arguments.json.replaces_text()) print_for_people(result);
  if (arguments.pictures) {
    std::filesystem::create_directories(*arguments.pictures);
    command_line::write_text_file(*arguments.pictures / "before.png", result.pictures->before_png);
    command_line::write_text_file(*arguments.pictures / "after.png", result.pictures->after_png);
  }
  if (arguments.report.is_asked()) {
    arguments.report.write(mapping::to_html(result, {.map = arguments.map.string(),
                                                     .drive = arguments.drive->string(),
                                                     .classes = arguments.classes,
                                                     .command = command_line::command_of(command)}),
                           arguments.json);
  }
  return mapping::to_json(result, arguments.classes);
}

void evaluate(const MapArguments& arguments, const CLI::App& command) {
  const auto map = maps::MapPackage::open(arguments.map);
  std::optional<maps::Drive> drive;
  if (arguments.drive) drive = maps::Drive::open(*arguments.drive, arguments.poses);
  auto bar = std::make_unique<command_line::ProgressBar>();
  const auto progress = [&bar](std::string_view stage, std::size_t done, std::size_t total) {
    bar->update(stage, done, total);
  };
  // The bar goes before anything else is printed.
  const auto done = [&bar] { bar.reset(); };
  const mapping::MapConsistency consistency =
      mapping::map_consistency(*map, 0, progress, command_line::cancel_flag());
  std::string json = "{}";
  if (!drive) {
    done();
  } else if (arguments.boxes) {
    json = evaluate_boxes(arguments, {*map, *drive, progress, done});
  } else {
    json = evaluate_points(arguments, command, {*map, *drive, progress, done});
  }
  if (!arguments.json.replaces_text()) print_consistency(consistency);
  if (arguments.json.is_asked()) arguments.json.write(to_json_text(json, consistency, arguments));
}

}  // namespace

void add_map(CLI::App& evaluate_command) {
  auto arguments = std::make_shared<MapArguments>();
  CLI::App* command =
      evaluate_command.add_subcommand("map",
                                      "Measure how well a map's scans agree with each other; with "
                                      "--truth also what is left of movable objects, what was lost "
                                      "of the rest, and how right the ground is");
  command->add_option("MAP", arguments->map, "Folder of the map package")
      ->required()
      ->check(command_line::existing_folder());
  CLI::Option* truth =
      command
          ->add_option("--truth", arguments->drive,
                       "Drive that the map was built from, with labelled points (SemanticKITTI)")
          ->check(command_line::existing_drive());
  const std::map<std::string, TruthClasses> classes{{"moving", TruthClasses::kMoving},
                                                    {"movable", TruthClasses::kMovable}};
  command
      ->add_option_function<std::string>(
          "--truth-classes",
          [arguments, classes](const std::string& name) { arguments->classes = classes.at(name); },
          "What should not be in the map: moving, or movable (also parked)")
      ->default_str(std::string(name_of(arguments->classes)))
      ->check(command_line::one_of({"moving", "movable"}))
      ->needs(truth);
  command
      ->add_option(
          "--poses", arguments->poses,
          "Poses that the map was built with, if not the drive's own: KITTI, TUM, CSV or g2o")
      ->check(command_line::existing_path())
      ->needs(truth);
  command
      ->add_option("--boxes", arguments->boxes,
                   "Labelled boxes, for a drive without labelled points: KITTI tracking or JSON "
                   "(format stillmap-boxes)")
      ->check(command_line::existing_file())
      ->needs(truth);
  command
      ->add_option("--pictures", arguments->pictures,
                   "Draw before.png and after.png, seen from above, into this folder")
      ->type_name("FOLDER")
      ->needs(truth);
  arguments->json.add_to(*command);
  arguments->report.add_to(*command)->needs(truth);
  command->callback([arguments, command] { evaluate(*arguments, *command); });
}

}  // namespace stillmap::evaluate
