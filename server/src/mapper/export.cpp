#include <stillmap/mapping/progress.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_export.hpp>

#include <fmt/core.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "command_line/progress_bar.hpp"
#include "command_line/run_program.hpp"
#include "command_line/table.hpp"
#include "mapper/commands.hpp"
#include "reference/octomap_export.hpp"

namespace stillmap::mapper {
namespace {

using maps::ExportFrame;
using maps::PointChoice;

struct ExportArguments {
  std::filesystem::path map;
  std::filesystem::path output;
  std::string format;
  std::optional<std::filesystem::path> json;
  std::vector<double> height_band_m;
  maps::MapExportOptions options;
};

const std::map<std::string, PointChoice> kChoices = {{"all", PointChoice::kAll},
                                                     {"no-filled", PointChoice::kNoFilled},
                                                     {"measured", PointChoice::kMeasured}};
const std::map<std::string, ExportFrame> kFrames = {
    {"map", ExportFrame::kMap}, {"local", ExportFrame::kLocal}, {"utm", ExportFrame::kUtm}};

std::vector<maps::ExportFormat> formats() {
  std::vector<maps::ExportFormat> all = maps::export_formats();
  all.push_back(mapping::octomap_format());
  return all;
}

maps::MapExportReport write_map(const ExportArguments& arguments) {
  const auto package = maps::MapPackage::open(arguments.map);
  command_line::ProgressBar bar;
  const maps::ExportProgress progress = [&bar](std::string_view stage, std::size_t done,
                                               std::size_t total) {
    if (command_line::cancel_flag()) throw mapping::Cancelled();
    bar.update(stage, done, total);
  };
  if (arguments.format == mapping::octomap_format().name)
    return mapping::export_octomap(*package, arguments.output, arguments.options, progress);
  return maps::export_map(*package, arguments.format, arguments.output, arguments.options,
                          progress);
}

std::string to_json_text(const maps::MapExportReport& report, const ExportArguments& arguments) {
  const Eigen::Vector3d& origin = report.origin;
  const nlohmann::ordered_json json = {{"format", arguments.format},
                                       {"counts", report.counts},
                                       {"origin", {origin.x(), origin.y(), origin.z()}},
                                       {"notes", report.notes},
                                       {"version", STILLMAP_VERSION}};
  return json.dump(2) + "\n";
}

void export_package(ExportArguments& arguments) {
  if (!arguments.height_band_m.empty())
    arguments.options.height_band_m = {arguments.height_band_m[0], arguments.height_band_m[1]};
  const maps::MapExportReport report = write_map(arguments);
  command_line::Table table;
  table.add("written", arguments.output.string());
  for (const auto& [name, count] : report.counts) {
    std::string label = name;
    std::replace(label.begin(), label.end(), '_', ' ');
    table.add(std::move(label), command_line::grouped(count));
  }
  if (!report.origin.isZero())
    table.add("map coordinates", fmt::format("these + {} {} {} m", report.origin.x(),
                                             report.origin.y(), report.origin.z()));
  table.print();
  for (const std::string& note : report.notes) fmt::print("note: {}\n", note);
  if (arguments.json) write_text_file(*arguments.json, to_json_text(report, arguments));
}

void add_point_options(CLI::App& command, ExportArguments& arguments) {
  maps::MapExportOptions& options = arguments.options;
  command
      .add_option("--points", options.points,
                  "all, no-filled (without synthetic ground) or measured (also without what was "
                  "moved down from objects)")
      ->transform(CLI::Transformer(kChoices))
      ->default_str("all");
  command
      .add_option("--coordinates", options.frame,
                  "map (its frame), local (less the map's origin) or utm; each format has its own")
      ->transform(CLI::Transformer(kFrames));
  command.add_flag("--kinds", options.kinds,
                   "pcd: a fifth field that says what each point is (0 measured, 1 ground, 2 "
                   "moved down, 3 filled)");
  command.add_option("--resolution", options.resolution_m,
                     "nav2, octomap: edge of a cell [m]; 0.1 and 0.2 unless told");
  command
      .add_option("--height-band", arguments.height_band_m,
                  "nav2: obstacles stand between these heights above the ground [m]; 0.2 and 2 "
                  "unless told")
      ->expected(2)
      ->delimiter(',');
  command.add_option("--drive", options.drive,
                     "kitti, tum: which trajectory of a map of several drives, from 0");
}

}  // namespace

void add_export(CLI::App& app) {
  auto arguments = std::make_shared<ExportArguments>();
  CLI::App* command = app.add_subcommand("export", "Write a map in another program's format");
  std::vector<std::string> names;
  std::string help;
  for (const maps::ExportFormat& format : formats()) {
    names.emplace_back(format.name);
    help += fmt::format("{}{}: {}", help.empty() ? "" : "\n", format.name, format.description);
  }
  command->add_option("MAP", arguments->map, "Map package")
      ->required()
      ->check(command_line::existing_folder());
  command->add_option("-o,--output", arguments->output, "File or folder to write; must not exist")
      ->required();
  command->add_option("--format", arguments->format, help)->required()->check(CLI::IsMember(names));
  add_point_options(*command, *arguments);
  command->add_option("--json", arguments->json, "Write the report there")
      ->check(command_line::in_existing_folder());
  command->callback([arguments] { export_package(*arguments); });
}

}  // namespace stillmap::mapper
