#include <stillmap/mapping/map_evaluation.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/map_package.hpp>

#include <fmt/core.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "command_line/progress_bar.hpp"
#include "command_line/run_program.hpp"
#include "command_line/table.hpp"
#include "mapper/commands.hpp"

namespace stillmap::mapper {
namespace {

using command_line::grouped;

struct EvaluateArguments {
  std::filesystem::path map;
  std::filesystem::path drive;
  std::optional<std::filesystem::path> poses;
  std::optional<std::filesystem::path> json;
  mapping::MapEvaluationOptions options;
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

std::string to_json_text(const mapping::MapEvaluation& result, const EvaluateArguments& arguments) {
  auto json = nlohmann::ordered_json::parse(mapping::to_json(result));
  json["version"] = STILLMAP_VERSION;
  json["options"] = {{"map", arguments.map.string()},
                     {"truth", arguments.drive.string()},
                     {"boxes", arguments.options.boxes_file.string()}};
  return json.dump(2) + "\n";
}

void evaluate(const EvaluateArguments& arguments) {
  const auto map = maps::MapPackage::open(arguments.map);
  const maps::Drive drive = maps::Drive::open(arguments.drive, arguments.poses);
  mapping::MapEvaluation result;
  {
    command_line::ProgressBar bar;
    result = mapping::evaluate_map(
        *map, drive, arguments.options,
        [&bar](std::string_view stage, std::size_t done, std::size_t total) {
          bar.update(stage, done, total);
        },
        command_line::cancel_flag());
  }
  print_for_people(result);
  if (arguments.json) write_text_file(*arguments.json, to_json_text(result, arguments));
}

}  // namespace

void add_evaluate_map(CLI::App& evaluate_command) {
  auto arguments = std::make_shared<EvaluateArguments>();
  mapping::MapEvaluationOptions& options = arguments->options;
  CLI::App* command = evaluate_command.add_subcommand(
      "map", "Count what a map kept of labelled objects, and what it changed beside them");
  command->add_option("MAP", arguments->map, "Map package")
      ->required()
      ->check(command_line::existing_folder());
  command->add_option("--truth", arguments->drive, "The drive that the map was made from")
      ->required()
      ->check(command_line::existing_folder());
  command
      ->add_option("--poses", arguments->poses,
                   "The poses that the map was made with, when not the drive's own")
      ->check(command_line::existing_file());
  command->add_option("--boxes", options.boxes_file, "Labels: KITTI tracking or our JSON")
      ->required()
      ->check(command_line::existing_file());
  command->add_option("--pictures", options.pictures_folder,
                      "Draw before.png and after.png, seen from above, there");
  command->add_option("--json", arguments->json, "Write the result there")
      ->check(command_line::in_existing_folder());
  command->callback([arguments] { evaluate(*arguments); });
}

}  // namespace stillmap::mapper
