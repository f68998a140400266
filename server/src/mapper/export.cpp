#include <stillmap/mapping/octomap_export.hpp>
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
#include <thread>
#include <utility>
#include <vector>

#include "command_line/option_value.hpp"
#include "command_line/progress_bar.hpp"
#include "command_line/result_output.hpp"
#include "command_line/run_program.hpp"
#include "command_line/table.hpp"
#include "mapper/commands.hpp"

namespace stillmap::mapper {
namespace {

using maps::ExportFrame;
using maps::PointKind;

struct ExportArguments {
  std::filesystem::path map;
  std::filesystem::path output;
  std::string format;
  command_line::JsonOutput json;
  std::vector<std::string> without;
  std::string coordinates;
  std::vector<double> height_band_m;
  maps::MapExportOptions options;
};

const std::map<std::string, PointKind> kKinds = {{"measured", PointKind::kMeasured},
                                                 {"ground", PointKind::kGround},
                                                 {"projected", PointKind::kProjected},
                                                 {"filled", PointKind::kFilled}};
const std::map<std::string, ExportFrame> kFrames = {
    {"map", ExportFrame::kMap},
    {"local", ExportFrame::kLocal},
    {"utm", ExportFrame::kUtm},
    {"mgrs", ExportFrame::kMgrs},
    {"transverse-mercator", ExportFrame::kTransverseMercator}};

std::vector<maps::MapExportFormat> formats() {
  std::vector<maps::MapExportFormat> all = maps::map_export_formats();
  all.push_back(mapping::octomap_format());
  return all;
}

maps::MapExportResult write_map(const ExportArguments& arguments) {
  const auto package = maps::MapPackage::open(arguments.map);
  command_line::ProgressBar bar;
  maps::MapExportOptions options = arguments.options;
  for (const std::string& kind : arguments.without) options.without.insert(kKinds.at(kind));
  if (!arguments.coordinates.empty()) options.frame = kFrames.at(arguments.coordinates);
  if (!arguments.height_band_m.empty())
    options.height_band_m = {arguments.height_band_m[0], arguments.height_band_m[1]};
  options.work.threads = std::max(1U, std::thread::hardware_concurrency());
  options.work.go_on = [&bar](double share) {
    bar.update("write", static_cast<std::size_t>(1000.0 * share), 1000);
    return !command_line::cancel_flag();
  };
  if (arguments.format == mapping::octomap_format().name)
    return mapping::export_octomap(*package, arguments.output, options);
  return maps::export_map(*package, arguments.format, arguments.output, options);
}

std::string to_json_text(const maps::MapExportResult& result, const ExportArguments& arguments) {
  const Eigen::Vector3d& origin = result.origin;
  const nlohmann::ordered_json json = {
      {"format", arguments.format}, {"points", result.points},
      {"files", result.files},      {"bytes", result.bytes},
      {"counts", result.counts},    {"origin", {origin.x(), origin.y(), origin.z()}},
      {"notes", result.notes},      {"version", STILLMAP_VERSION}};
  return json.dump(2);
}

void export_package(const ExportArguments& arguments) {
  const maps::MapExportResult result = write_map(arguments);
  arguments.json.write(to_json_text(result, arguments));
  if (arguments.json.replaces_text()) return;
  command_line::Table table;
  table.add("written", arguments.output.string());
  table.add("points", command_line::grouped(result.points));
  table.add("files", command_line::grouped(result.files));
  table.add("bytes", command_line::grouped(result.bytes));
  for (const auto& [name, count] : result.counts) {
    std::string label = name;
    std::replace(label.begin(), label.end(), '_', ' ');
    table.add(std::move(label), command_line::grouped(count));
  }
  if (!result.origin.isZero())
    table.add("map coordinates", fmt::format("these + {} {} {} m", result.origin.x(),
                                             result.origin.y(), result.origin.z()));
  table.print();
  for (const std::string& note : result.notes) fmt::print("note: {}\n", note);
}

template <typename Value>
std::vector<std::string> names_of(const std::map<std::string, Value>& values) {
  std::vector<std::string> names;
  for (const auto& [name, value] : values) names.push_back(name);
  return names;
}

void add_point_options(CLI::App& command, ExportArguments& arguments) {
  maps::MapExportOptions& options = arguments.options;
  command
      .add_option("--without", arguments.without,
                  "Kinds of points to leave out, with commas between: measured, ground, projected "
                  "(moved down from objects), filled (synthetic ground)")
      ->delimiter(',')
      ->check(command_line::one_of(names_of(kKinds)));
  command
      .add_option("--coordinates", arguments.coordinates,
                  "Frame of the coordinates: map, local (map minus an origin near it), utm, and "
                  "for autoware "
                  "also mgrs and transverse-mercator (default: depends on the format)")
      ->check(command_line::one_of(names_of(kFrames)));
  command.add_flag("--kinds", options.kinds,
                   "pcd: add a fifth field with the kind of each point (0 measured, 1 ground, 2 "
                   "projected, 3 filled)");
  command.add_option("--resolution", options.resolution_m,
                     "Edge of a cell [m] (default: 0.1 for nav2, 0.2 for octomap)");
  command
      .add_option("--height-band", arguments.height_band_m,
                  "nav2: lowest and highest height of obstacles above the ground [m] (default: 0.2 "
                  "2)")
      ->expected(2)
      ->delimiter(',');
  command.add_option("--drive", options.drive,
                     "kitti, tum: which trajectory of a map of several drives, from 0");
}

}  // namespace

void add_export(CLI::App& app) {
  auto arguments = std::make_shared<ExportArguments>();
  CLI::App* command = app.add_subcommand("export", "Write a map in a format of other programs");
  std::vector<std::string> names;
  std::string listed = "Formats:";
  for (const maps::MapExportFormat& format : formats()) {
    names.emplace_back(format.name);
    listed += fmt::format("\n  {:<10} {}", format.name, format.description);
  }
  command->footer(listed);
  command->add_option("MAP", arguments->map, "Folder of the map package")
      ->required()
      ->check(command_line::existing_folder());
  command->add_option("--format", arguments->format, "Format to write, see below")
      ->required()
      ->check(command_line::one_of(names));
  command->add_option("-o,--output", arguments->output, "File or folder to write; must not exist")
      ->type_name("PATH")
      ->required();
  add_point_options(*command, *arguments);
  arguments->json.add_to(*command);
  command->callback([arguments] { export_package(*arguments); });
}

}  // namespace stillmap::mapper
