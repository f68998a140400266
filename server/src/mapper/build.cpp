#include <stillmap/mapping/map_build.hpp>

#include <fmt/core.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <stillmap/localization/map_index.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>
#include <string>

#include "command_line/progress_bar.hpp"
#include "command_line/run_program.hpp"
#include "command_line/table.hpp"
#include "mapper/commands.hpp"

namespace stillmap::mapper {
namespace {

using command_line::grouped;

struct BuildArguments {
  std::filesystem::path drive;
  std::filesystem::path map;
  std::string select = "::";
  std::string movable;
  std::optional<std::filesystem::path> json;
  mapping::MapBuildOptions options;
};

std::string to_json_text(const mapping::MapBuildReport& report, const BuildArguments& arguments) {
  const mapping::MapBuildOptions& options = arguments.options;
  auto json = nlohmann::ordered_json::parse(mapping::to_json(report));
  json["version"] = STILLMAP_VERSION;
  json["options"] = {{"drive", arguments.drive.string()},
                     {"select", arguments.select},
                     {"poses", options.poses_file ? options.poses_file->string() : ""},
                     {"detector", options.detector},
                     {"movable", arguments.movable},
                     {"margin_m", options.projection.margin_m},
                     {"voxel_m", options.voxel_size_m},
                     {"min_range_m", options.min_range_m},
                     {"max_range_m", options.max_range_m},
                     {"threads", options.threads}};
  return json.dump(2) + "\n";
}

/// Writes the index beside the tiles, so that the first query need not. A map that is too sparse to
/// be searched is still a map.
/// @return where it is, or why there is none.
std::string write_index(const std::filesystem::path& map) {
  try {
    const auto index = localization::MapIndex::open(*maps::MapPackage::open(map));
    return index->file().empty() ? index->kept_in_memory_because() : index->file().string();
  } catch (const maps::InputError& error) {
    return std::string("none: ") + error.what();
  }
}

void print_for_people(const mapping::MapBuildReport& report, const BuildArguments& arguments,
                      const std::string& index) {
  command_line::Table table;
  table.add("map", arguments.map.string());
  table.add("digest", report.digest);
  table.add("index", index);
  table.add("scans", fmt::format("{} in {:.1f} s, {:.1f} a second", report.scans, report.seconds,
                                 report.scans_per_second));
  table.add("peak memory", fmt::format("{:.0f} MiB", report.peak_rss_mib));
  for (const auto& [name, count] : report.points) table.add("points " + name, grouped(count));
  for (const auto& [name, count] : report.objects) table.add("objects " + name, grouped(count));
  table.print();
}

void build(BuildArguments& arguments) {
  arguments.options.selection = maps::Selection::parse(arguments.select);
  arguments.options.projection.policy = mapping::movable_policy_from(arguments.movable);
  mapping::MapBuildReport report;
  std::string index;
  {
    command_line::ProgressBar bar;
    report = mapping::build_map(
        arguments.drive, arguments.map, arguments.options,
        [&bar](std::string_view stage, std::size_t done, std::size_t total) {
          bar.update(stage, done, total);
        },
        command_line::cancel_flag());
    bar.update("index", 0, 1);
    index = write_index(arguments.map);
    bar.update("index", 1, 1);
  }
  print_for_people(report, arguments, index);
  if (arguments.json) write_text_file(*arguments.json, to_json_text(report, arguments));
}

}  // namespace

void add_build(CLI::App& app) {
  auto arguments = std::make_shared<BuildArguments>();
  mapping::MapBuildOptions& options = arguments->options;
  arguments->movable = mapping::name_of(options.projection.policy);
  CLI::App* command = app.add_subcommand("build", "Make a map package from a drive");
  command
      ->add_option(
          "DRIVE", arguments->drive,
          "KITTI raw or odometry, key frame folder, or a folder of .pcd, .ply or .bin scans")
      ->required()
      ->check(command_line::existing_folder());
  command->add_option("-o,--output", arguments->map, "Map package to write; must not exist")
      ->required();
  command->add_option("--select", arguments->select, "Scans to take, begin:end:step as in Python")
      ->capture_default_str();
  command
      ->add_option("--poses", options.poses_file,
                   "Poses instead of the drive's own: KITTI or TUM, T_map_lidar")
      ->check(command_line::existing_file());
  command
      ->add_option("--detector", options.detector,
                   "What finds movable objects: geometric, or boxes:FILE with KITTI tracking "
                   "labels or our JSON")
      ->capture_default_str();
  command
      ->add_option(
          "--movable", arguments->movable,
          "What happens to points of movable objects: project (onto the ground), delete or keep")
      ->capture_default_str();
  command
      ->add_option("--voxel", options.voxel_size_m,
                   "Edge of the voxels that merge the map's points [m]")
      ->capture_default_str();
  command
      ->add_option("--threads", options.threads,
                   "Threads; 0 = all cores. The map does not depend on it")
      ->capture_default_str();
  command->add_option("--json", arguments->json, "Write the report there")
      ->check(command_line::in_existing_folder());
  command->callback([arguments] { build(*arguments); });
}

}  // namespace stillmap::mapper
