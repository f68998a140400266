#include <stillmap/mapping/map_import.hpp>

#include <fmt/core.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "command_line/command_text.hpp"
#include "command_line/progress_bar.hpp"
#include "command_line/run_program.hpp"
#include "command_line/table.hpp"
#include "mapper/commands.hpp"
#include "mapper/map_index.hpp"

namespace stillmap::mapper {
namespace {

struct ImportArguments {
  std::filesystem::path file;
  std::filesystem::path map;
  std::optional<std::filesystem::path> json;
  std::string geo_origin, utm;
  mapping::MapImportOptions options;
};

std::string to_json_text(const mapping::MapImportReport& report, const ImportArguments& arguments) {
  auto json = nlohmann::ordered_json::parse(mapping::to_json(report));
  json["options"] = {{"file", arguments.file.string()},
                     {"frame_id", arguments.options.frame_id.value_or("")},
                     {"geo_origin", arguments.geo_origin},
                     {"utm", arguments.utm},
                     {"voxel_m", arguments.options.voxel_size_m},
                     {"threads", arguments.options.threads}};
  return json.dump(2) + "\n";
}

std::string label_of(std::string name) {
  if (name == "static") return "map points";
  if (name == "ground") return "of these ground";
  if (name == "places") return "places to look from";
  std::replace(name.begin(), name.end(), '_', ' ');
  return "points " + name;
}

void print_for_people(const mapping::MapImportReport& report, const ImportArguments& arguments,
                      const std::string& index) {
  command_line::Table table;
  table.add("map", arguments.map.string());
  table.add("digest", report.digest);
  table.add("index", index);
  table.add("time", fmt::format("{:.1f} s", report.seconds));
  table.add("peak memory", fmt::format("{:.0f} MiB", report.peak_rss_mib));
  for (const auto& [name, count] : report.counts)
    table.add(label_of(name), command_line::grouped(count));
  table.print();
  for (const std::string& warning : report.warnings) fmt::print("warning: {}\n", warning);
}

void import_cloud(const ImportArguments& arguments) {
  mapping::MapImportReport report;
  std::string index;
  {
    command_line::ProgressBar bar;
    report = mapping::import_map(
        arguments.file, arguments.map, arguments.options,
        [&bar](std::string_view stage, std::size_t done, std::size_t total) {
          bar.update(stage, done, total);
        },
        command_line::cancel_flag());
    bar.update("index", 0, 1);
    index = write_index(arguments.map);
    bar.update("index", 1, 1);
  }
  print_for_people(report, arguments, index);
  if (arguments.json)
    command_line::write_text_file(*arguments.json, to_json_text(report, arguments));
}

}  // namespace

void add_import(CLI::App& app) {
  auto arguments = std::make_shared<ImportArguments>();
  mapping::MapImportOptions& options = arguments->options;
  CLI::App* command =
      app.add_subcommand("import", "Make a map package from a point cloud map (PCD, PLY, LAS)");
  command
      ->add_option("FILE", arguments->file,
                   "Points x y z [m] in the map frame, z up, in floats or doubles; intensity where "
                   "there is one")
      ->required()
      ->check(command_line::existing_file());
  command->add_option("-o,--output", arguments->map, "Map package to write; must not exist")
      ->required();
  command->add_option("--frame-id", options.frame_id,
                      "Name of the map's frame; enu where its place is known, else local");
  command->add_option("--geo-origin", arguments->geo_origin,
                      "LATITUDE,LONGITUDE,ALTITUDE [deg, deg, m above the WGS 84 ellipsoid] of the "
                      "map's frame, x east, y north");
  command->add_option("--utm", arguments->utm,
                      "Coordinates are UTM in this zone, e.g. 32N, where the file does not say so");
  command
      ->add_option("--voxel-size,--voxel", options.voxel_size_m,
                   "Edge of the voxels that merge the points [m]")
      ->capture_default_str();
  command
      ->add_option("--threads", options.threads,
                   "Threads; 0 = all cores. The map does not depend on it")
      ->capture_default_str();
  command->add_option("--json", arguments->json, "Write the report there")
      ->check(command_line::in_existing_folder());
  command->callback([arguments] {
    if (!arguments->geo_origin.empty())
      arguments->options.geodetic_origin = command_line::parse_geo_origin(arguments->geo_origin);
    if (!arguments->utm.empty())
      arguments->options.utm = command_line::parse_utm_zone(arguments->utm);
    import_cloud(*arguments);
  });
}

}  // namespace stillmap::mapper
