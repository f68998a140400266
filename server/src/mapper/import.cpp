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
#include "command_line/result_output.hpp"
#include "command_line/run_program.hpp"
#include "command_line/table.hpp"
#include "mapper/commands.hpp"
#include "mapper/map_index.hpp"

namespace stillmap::mapper {
namespace {

struct ImportArguments {
  std::filesystem::path file;
  std::filesystem::path map;
  command_line::JsonOutput json;
  std::string geo_origin, utm;
  mapping::MapImportOptions options;
};

std::string to_json_text(const mapping::MapImportResult& result, const ImportArguments& arguments) {
  auto json = nlohmann::ordered_json::parse(mapping::to_json(result));
  json["options"] = {
      {"file", arguments.file.string()},     {"frame_id", arguments.options.frame_id.value_or("")},
      {"geo_origin", arguments.geo_origin},  {"utm", arguments.utm},
      {"up", arguments.options.up},          {"voxel_m", arguments.options.voxel_size_m},
      {"threads", arguments.options.threads}};
  return json.dump(2);
}

std::string label_of(std::string name) {
  if (name == "static") return "map points";
  if (name == "ground") return "of these ground";
  if (name == "places") return "places to look from";
  std::replace(name.begin(), name.end(), '_', ' ');
  return "points " + name;
}

void print_for_people(const mapping::MapImportResult& result, const ImportArguments& arguments,
                      const std::string& index) {
  command_line::Table table;
  table.add("map", arguments.map.string());
  table.add("digest", result.digest);
  table.add("index", index);
  table.add("time", fmt::format("{:.1f} s", result.seconds));
  table.add("peak memory", fmt::format("{:.0f} MiB", result.peak_rss_mib));
  for (const auto& [name, count] : result.counts)
    table.add(label_of(name), command_line::grouped(count));
  table.print();
  for (const std::string& warning : result.warnings) fmt::print("warning: {}\n", warning);
}

void import_cloud(const ImportArguments& arguments) {
  mapping::MapImportResult result;
  std::string index;
  {
    command_line::ProgressBar bar;
    result = mapping::import_map(
        arguments.file, arguments.map, arguments.options,
        [&bar](std::string_view stage, std::size_t done, std::size_t total) {
          bar.update(stage, done, total);
        },
        command_line::cancel_flag());
    command_line::say_when_cancelled(
        {.kept = arguments.map,
         .if_kept =
             fmt::format("the map in {} is complete; its index is made when it is first used",
                         arguments.map.string()),
         .if_not = {}});
    bar.update("index", 0, 1);
    index = write_index(arguments.map);
    bar.update("index", 1, 1);
  }
  if (!arguments.json.replaces_text()) print_for_people(result, arguments, index);
  if (arguments.json.is_asked()) arguments.json.write(to_json_text(result, arguments));
}

}  // namespace

void add_import(CLI::App& app) {
  auto arguments = std::make_shared<ImportArguments>();
  mapping::MapImportOptions& options = arguments->options;
  CLI::App* command = app.add_subcommand("import", command_line::kImportDescription);
  command
      ->add_option("FILE", arguments->file,
                   "Point cloud: x y z [m] in the map frame, z up, floats or doubles, intensity if "
                   "there is one; or the folder of an Autoware map, with pointcloud_map.pcd and "
                   "map_projector_info.yaml")
      ->required()
      ->check(command_line::existing_path());
  command
      ->add_option("-o,--output", arguments->map,
                   "Folder of the map package to write; must not exist")
      ->type_name("FOLDER")
      ->required();
  command->add_option("--frame-id", options.frame_id,
                      "Name of the map's frame (default: enu if its place on the earth is known, "
                      "else local)");
  command->add_option("--geo-origin", arguments->geo_origin,
                      "LATITUDE,LONGITUDE,ALTITUDE [deg, deg, m above the WGS 84 ellipsoid] of the "
                      "map's origin (x east, y north)");
  command->add_option("--utm", arguments->utm,
                      "UTM zone of the coordinates, for example 32N, if the file does not say it");
  command
      ->add_option("--up", options.up,
                   "Axis of the coordinates that points up: x, -x, y, -y, z or -z; y for maps in "
                   "LOAM's camera axes")
      ->capture_default_str();
  command
      ->add_option("--voxel,--voxel-size", options.voxel_size_m,
                   "Edge of the voxels into which points are merged [m]")
      ->capture_default_str();
  command
      ->add_option("--threads", options.threads,
                   "Threads; 0 = all cores. The map is the same with any number")
      ->capture_default_str();
  arguments->json.add_to(*command);
  command->callback([arguments] {
    if (!arguments->geo_origin.empty())
      arguments->options.geodetic_origin = command_line::parse_geo_origin(arguments->geo_origin);
    if (!arguments->utm.empty())
      arguments->options.utm = command_line::parse_utm_zone(arguments->utm);
    import_cloud(*arguments);
  });
}

}  // namespace stillmap::mapper
