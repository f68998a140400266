#include <stillmap/mapping/build_estimate.hpp>
#include <stillmap/mapping/map_build.hpp>
#include <stillmap/mapping/odometry.hpp>
#include <stillmap/mapping/reference.hpp>

#include <fmt/core.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <iterator>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <stdexcept>
#include <stillmap/maps/drive_check.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/hidden_beside.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/sensor_preset.hpp>
#include <stillmap/maps/usable_memory.hpp>
#include <string>
#include <system_error>
#include <vector>

#include "command_line/command_text.hpp"
#include "command_line/consistency_rows.hpp"
#include "command_line/option_value.hpp"
#include "command_line/result_output.hpp"
#include "command_line/run_program.hpp"
#include "command_line/table.hpp"
#include "mapper/build_arguments.hpp"
#include "mapper/commands.hpp"
#include "mapper/map_index.hpp"
#include "mapper/progress_output.hpp"
#include "mapper/units.hpp"

namespace stillmap::mapper {
namespace {

using command_line::grouped;

struct BuildCommand {
  BuildArguments arguments;
  std::filesystem::path map;
  command_line::JsonOutput json;
  ProgressArguments progress;
  UnitArguments units;
  bool estimate = false;
};

/// Notes and warnings about the drives before a build starts.
struct Remarks {
  std::vector<maps::Drive> drives;
  /// What their readers assumed or left out.
  std::vector<std::string> notes;
  /// What looks wrong with them, as the build will use them.
  std::vector<std::string> doubts;
};

std::string to_json_text(const mapping::MapBuildResult& result, const BuildArguments& arguments,
                         const std::vector<std::string>& notes) {
  const mapping::MapBuildOptions options = mapping::completed(arguments.options);
  auto json = nlohmann::ordered_json::parse(mapping::to_json(result));
  json["notes"] = notes;
  json["version"] = STILLMAP_VERSION;
  std::vector<std::string> drives;
  for (const std::filesystem::path& drive : arguments.drives) drives.push_back(drive.string());
  json["options"] = {{"drives", drives},
                     {"preset", arguments.preset},
                     {"select", arguments.select},
                     {"poses", options.poses_file ? options.poses_file->string() : ""},
                     {"pose_time_offset", arguments.pose_time_offset},
                     {"geo_origin", arguments.geo_origin},
                     {"odometry", options.odometry.value_or("")},
                     {"given_poses", name_of(options.given_poses)},
                     {"loops", options.trajectory.loops},
                     {"register_to", options.register_to ? options.register_to->string() : ""},
                     {"pose_sigma", arguments.pose_sigma.value_or("")},
                     {"detector", options.detector},
                     {"movable", arguments.movable},
                     {"ground_height", name_of(options.projection.ground_height)},
                     {"fusion", options.fusion},
                     {"edits", options.edits_file ? options.edits_file->string() : ""},
                     {"fill", options.fills_ground()},
                     {"clean", options.clean},
                     {"margin_m", options.projection.margin_m},
                     {"voxel_m", options.voxel_size_m},
                     {"min_range_m", options.min_range_m},
                     {"max_range_m", options.max_range_m},
                     {"threads", options.threads}};
  if (options.trajectory.gnss_sigma_m)
    json["options"]["gnss_sigma_m"] = *options.trajectory.gnss_sigma_m;
  if (options.ground.sensor_height_m)
    json["options"]["sensor_height_m"] = *options.ground.sensor_height_m;
  return json.dump(2);
}

double in_degrees(double rad) { return rad * 180.0 / std::numbers::pi; }

/// What a count of the report is of: points as they were scanned, or those of the map's voxels.
std::string points_label(std::string name) {
  if (name == "static") return "map points";
  if (name == "cleaned" || name == "filled") return "map points " + name;
  if (name == "scans_empty") return "scans without points";
  if (name == "scans_hidden") return "scans hidden, left out";
  std::replace(name.begin(), name.end(), '_', ' ');
  return "scanned points " + name;
}

std::string trajectory_label(std::string name) {
  if (name == "scans_predicted") return "scans placed by motion alone";
  std::replace(name.begin(), name.end(), '_', ' ');
  return name;
}

std::string objects_label(std::string name) {
  if (name == "boxes") return "boxes detected";
  if (name.starts_with("dropped: ")) return "boxes " + name;
  if (!name.starts_with("edits_")) return "objects " + name;
  std::replace(name.begin(), name.end(), '_', ' ');
  return name;
}

std::string registration_text(const maps::Registration& registration) {
  const bool kept = registration.T_map_poses.matrix().isIdentity(0.0);
  const Eigen::Isometry3d& T = kept ? registration.T_previous_map : registration.T_map_poses;
  return fmt::format(
      "{} of {} scans agree within {:.3f} m, {:.2f} deg; poses {} {:.3f} m, {:.2f} deg",
      registration.scans_used, registration.scans_asked, registration.residual_m,
      in_degrees(registration.residual_rad), kept ? "kept, off by" : "moved by",
      T.translation().norm(), in_degrees(maps::rotation_angle_rad(T.linear())));
}

void add_given_poses(const mapping::GivenPosesResult& given, command_line::Table& table) {
  const mapping::PoseDifferences& neighbours = given.errors.by_way.front();
  if (neighbours.pairs > 0)
    table.add("given poses", fmt::format("neighbouring scans disagree by {:.3f} m, {:.2f} deg in "
                                         "the median, {:.3f} m, {:.2f} deg at most",
                                         neighbours.median_m, in_degrees(neighbours.median_rad),
                                         neighbours.max_m, in_degrees(neighbours.max_rad)));
  if (given.use == mapping::GivenPosesUse::kRefine && given.moved.pairs == 0)
    table.add("moved by", "0 m: they agree with the scans' own motion");
  else if (given.use == mapping::GivenPosesUse::kRefine)
    table.add("moved by", fmt::format("{:.3f} m, {:.2f} deg in the median, {:.3f} m, {:.2f} deg at "
                                      "most",
                                      given.moved.median_m, in_degrees(given.moved.median_rad),
                                      given.moved.max_m, in_degrees(given.moved.max_rad)));
}

void print_for_people(const mapping::MapBuildResult& result, const std::filesystem::path& map,
                      const std::string& index) {
  command_line::Table table;
  table.add("map", map.string());
  table.add("digest", result.digest);
  table.add("index", index);
  table.add("scans", fmt::format("{} in {:.1f} s, {:.1f} a second", result.scans, result.seconds,
                                 result.scans_per_second));
  if (result.resumed_scans > 0)
    table.add("of these resumed",
              fmt::format("{} from an earlier build that did not end", result.resumed_scans));
  table.add("peak memory", fmt::format("{:.0f} MiB", result.peak_rss_mib));
  for (const auto& [name, count] : result.trajectory)
    table.add(trajectory_label(name), grouped(count));
  if (result.given_poses) add_given_poses(*result.given_poses, table);
  if (result.registration) table.add("registered", registration_text(*result.registration));
  for (const auto& [name, count] : result.points) table.add(points_label(name), grouped(count));
  for (const auto& [name, count] : result.objects) table.add(objects_label(name), grouped(count));
  command_line::add_consistency(table, result.consistency);
  table.print();
  for (const std::string& note : result.notes) fmt::print("note: {}\n", note);
  for (const std::string& warning : result.warnings) fmt::print("warning: {}\n", warning);
}

void print_what_was_made(const BuildCommand& asked) {
  command_line::Table table;
  table.add("made", asked.map.string());
  const std::filesystem::path picture = asked.map / "preview.png";
  if (std::filesystem::exists(picture)) table.add("picture", picture.string());
  if (!asked.json.file().empty()) table.add("result", asked.json.file().string());
  table.add("next",
            fmt::format("{} serve {}", command_line::shell_word(command_line::program_name()),
                        command_line::shell_word(asked.map.string())));
  fmt::print("\n");
  table.print();
}

std::uint64_t free_bytes_beside(const std::filesystem::path& map) {
  std::error_code error;
  const auto space = std::filesystem::space(
      std::filesystem::absolute(map).lexically_normal().parent_path(), error);
  return error ? std::numeric_limits<std::uint64_t>::max() : space.available;
}

void print_estimate(const BuildArguments& arguments, const command_line::JsonOutput& json) {
  const mapping::BuildEstimate estimate =
      mapping::estimate_build(arguments.drives, arguments.options);
  json.write(mapping::to_json(estimate));
  if (json.replaces_text()) return;
  command_line::Table table;
  table.add("drives", grouped(estimate.drives));
  table.add("scans", grouped(estimate.scans));
  table.add("memory", grouped(estimate.memory_bytes) + " bytes at most");
  table.add("map package", grouped(estimate.package_bytes) + " bytes at most");
  table.add("beside it", grouped(estimate.work_bytes) + " bytes at most, while it is built");
  table.print();
}

Remarks remarks_on(const BuildArguments& arguments, bool estimates_poses) {
  const mapping::MapBuildOptions& options = arguments.options;
  const bool believes = options.trajectory.prior || options.trajectory.gnss_sigma_m;
  Remarks remarks;
  for (const std::filesystem::path& folder : arguments.drives) {
    remarks.drives.push_back(maps::Drive::open(folder, options.poses_file,
                                               std::llround(1e9 * options.pose_time_offset_s)));
    maps::Drive::Contents contents = remarks.drives.back().contents();
    for (const std::string& note : contents.notes)
      remarks.notes.push_back(fmt::format("{}: {}", folder.string(), note));
    // Who asks for odometry knows that there are no poses, or wants none.
    const bool wants_none = options.odometry.has_value() || !contents.T_map_lidar.empty();
    if (estimates_poses && !believes) contents.T_map_lidar.clear();
    for (const maps::DriveFinding& finding : maps::check_drive(maps::Drive(contents)).findings)
      if (finding.code != "no_poses" || !wants_none)
        remarks.doubts.push_back(
            fmt::format("{}: {}; {}", folder.string(), finding.what, finding.remedy));
  }
  return remarks;
}

/// The file exists once the poses are kept; before that, nothing that takes long is.
command_line::WhenCancelled when_cancelled(const std::filesystem::path& map) {
  const std::filesystem::path journal = maps::hidden_beside(map, ".partial") / "journal";
  command_line::WhenCancelled words = command_line::goes_on_from(journal);
  words.kept = journal / "survey.journal";
  words.if_not = "no stage is finished yet; the same command starts anew";
  return words;
}

void print_units_done(const BuildCommand& asked, const mapping::MapBuildResult& result) {
  if (asked.json.replaces_text()) return;
  for (const std::string& warning : result.warnings) fmt::print("warning: {}\n", warning);
  fmt::print("done: {}\n", asked.units.list);
}

/// Does some units of a build. @return what the last one did; with a digest when it made the map.
mapping::MapBuildResult do_units(const BuildCommand& asked,
                                 const std::vector<mapping::BuildUnit>& units,
                                 const mapping::ProgressCallback& progress) {
  mapping::MapBuildResult result;
  std::vector<std::string> warnings;
  for (const mapping::BuildUnit& unit : units) {
    const std::string name = name_of(unit);
    result = mapping::do_unit(asked.arguments.drives, asked.map, asked.arguments.options, unit,
                              asked.units.units, under_unit(unit, progress),
                              command_line::cancel_flag());
    if (result.digest.empty())
      for (const std::string& warning : result.warnings)
        warnings.push_back(fmt::format("{}: {}", name, warning));
  }
  result.warnings.insert(result.warnings.begin(), warnings.begin(), warnings.end());
  return result;
}

/// Looks at the drives, and tells people what there is to say.
/// @param is_whole  whether one process builds the map.
Remarks remarks_before(const BuildCommand& asked, bool is_whole) {
  const mapping::MapBuildOptions& options = asked.arguments.options;
  Remarks remarks =
      remarks_on(asked.arguments, mapping::estimates_poses(asked.arguments.drives, options));
  if (is_whole)
    std::ranges::move(
        mapping::shortages_of(mapping::estimate_build(remarks.drives, options),
                              maps::usable_memory_bytes(), free_bytes_beside(asked.map)),
        std::back_inserter(remarks.doubts));
  // Programs read what they are told on stderr, and the report.
  if (asked.progress.form == "bar") {
    for (const std::string& note : remarks.notes) fmt::print(stderr, "note: {}\n", note);
    for (const std::string& doubt : remarks.doubts) fmt::print(stderr, "warning: {}\n", doubt);
  }
  return remarks;
}

/// What `merge` said is what a build of one process says. The index is made there, too.
/// @return whether it is told; not where another process has told it.
bool build_by_jobs(const BuildCommand& asked, const CLI::App& command) {
  const mapping::MapBuildOptions& options = asked.arguments.options;
  mapping::require_usable_by_units(options, asked.units.units);
  const Remarks remarks = remarks_before(asked, false);
  const SlurmBuild build{
      .target = asked.map,
      .command = unit_command(command, {}),
      .prefix = {},
      .units = asked.units.units,
      .threads = options.threads,
      .memory_bytes = mapping::estimate_build(remarks.drives, options).memory_bytes,
      .options = asked.units.executor.slurm_options};
  command_line::say_when_cancelled(command_line::goes_on_from(mapping::units_folder(asked.map)));
  SlurmResult result;
  run_with_progress(asked.progress, mapping::build_stages(options.register_to.has_value()),
                    [&](const mapping::ProgressCallback& progress) {
                      result = build_in_slurm(build, progress, command_line::cancel_flag());
                    });
  if (!result.said) return false;
  fmt::print("{}", *result.said);
  std::fflush(stdout);
  return true;
}

void build(BuildCommand& asked, const CLI::App& command) {
  resolve_options(asked.arguments, command);
  if (asked.estimate) return print_estimate(asked.arguments, asked.json);
  require_unless_estimate(command, "--output");
  std::vector<mapping::BuildUnit> units = units_to_do(asked.units);
  if (!asked.units.plan.empty()) return write_plan(asked.units, asked.arguments.options, command);
  if (asked.units.executor.is_slurm()) {
    if (build_by_jobs(asked, command)) return;
    // Says what came of a map that is there.
    units = {{mapping::BuildUnit::Kind::kMerge}};
  }
  const std::vector<std::filesystem::path>& drives = asked.arguments.drives;
  const mapping::MapBuildOptions& options = asked.arguments.options;
  mapping::MapBuildResult result;
  std::string index;
  const Remarks remarks = remarks_before(asked, units.empty());
  const bool registers = options.register_to.has_value();
  std::vector<mapping::StageShare> plan =
      units.empty() ? mapping::build_stages(registers) : stages_of(units, registers);
  const bool merges = !units.empty() && units.back().kind == mapping::BuildUnit::Kind::kMerge;
  if (units.empty() || merges) plan.push_back({"index", 0.01});
  command_line::say_when_cancelled(
      units.empty() ? when_cancelled(asked.map)
                    : command_line::goes_on_from(mapping::units_folder(asked.map)));
  run_with_progress(asked.progress, plan, [&](const mapping::ProgressCallback& progress) {
    if (units.empty()) {
      result = mapping::build_map(drives, asked.map, options, progress, command_line::cancel_flag(),
                                  mapping::make_reference_cleaner);
    } else {
      result = do_units(asked, units, progress);
      if (result.digest.empty()) return;
    }
    command_line::say_when_cancelled(
        {.kept = asked.map,
         .if_kept =
             fmt::format("the map in {} is complete; its index is made when it is first used",
                         asked.map.string()),
         .if_not = {}});
    progress("index", 0, 1);
    index = write_index(asked.map);
    progress("index", 1, 1);
  });
  if (result.digest.empty()) return print_units_done(asked, result);
  if (!asked.json.replaces_text()) print_for_people(result, asked.map, index);
  result.warnings.insert(result.warnings.end(), remarks.doubts.begin(), remarks.doubts.end());
  result.notes.insert(result.notes.begin(), remarks.notes.begin(), remarks.notes.end());
  if (asked.json.is_asked()) asked.json.write(to_json_text(result, asked.arguments, result.notes));
  if (!asked.json.replaces_text()) print_what_was_made(asked);
}

void add_method_options(CLI::App& command, BuildArguments& arguments) {
  mapping::MapBuildOptions& options = arguments.options;
  const auto on_off = command_line::one_of({"on", "off"});
  command
      .add_option(
          "--preset", arguments.preset,
          "default, or paper (each scan on its own, objects to the scan's mean ground height, "
          "nothing filled or cleaned); an option given beside it wins")
      ->capture_default_str()
      ->check(command_line::one_of({"default", "paper"}));
  command
      .add_option("--fusion", arguments.fusion,
                  "Merge the objects and the ground of all scans before objects are projected")
      ->capture_default_str()
      ->check(on_off);
  command
      .add_option("--edits", options.edits_file,
                  "Corrections to apply: objects or regions to keep or to remove (JSON)")
      ->check(command_line::existing_file());
  command
      .add_option("--ground-height", arguments.ground_height,
                  "Height that objects are projected to: local (of the ground below them) or mean "
                  "(of the scan's ground, as in the paper)")
      ->capture_default_str()
      ->check(command_line::one_of({"local", "mean"}));
  command
      .add_option("--fill", arguments.fill,
                  "Fill the ground under objects where no point was projected")
      ->capture_default_str()
      ->check(on_off);
  std::vector<std::string> methods = mapping::reference_cleaner_names();
  methods.insert(methods.begin(), {"free-space", "none"});
  command
      .add_option(
          "--clean", options.clean,
          "Method that removes moving points that the detector missed: free-space or none; a "
          "program built with -DSTILLMAP_REFERENCE=ON has more, to compare with")
      ->capture_default_str()
      ->check(command_line::one_of(methods));
  command.add_option("--sensor-height", options.ground.sensor_height_m,
                     "Height of the sensor above the ground [m] (default: estimated)");
}

void add_range_options(CLI::App& command, BuildArguments& arguments) {
  mapping::MapBuildOptions& options = arguments.options;
  command
      .add_option(
          "--min-range", options.min_range_m,
          "Nearer points are left out, as they show the vehicle itself [m]; DRIVE?sensor=avia and "
          "mid-360 have their own default")
      ->capture_default_str();
  command
      .add_option(
          "--max-range", options.max_range_m,
          "Farther points are left out, as they are too sparse [m]; DRIVE?sensor=os0-... and "
          "mid-360 have their own default")
      ->capture_default_str();
}

void add_pose_options(CLI::App& command, BuildArguments& arguments) {
  mapping::MapBuildOptions& options = arguments.options;
  std::vector<std::string> methods = mapping::odometry_names();
  methods.insert(methods.begin(), "given");
  command
      .add_option("--odometry", options.odometry,
                  "Where poses come from: given (the drive's own or --poses), or a method of "
                  "odometry with loop closure (default: given, if there are poses)")
      ->check(command_line::one_of(methods));
  command
      .add_option("--given-poses", arguments.given_poses,
                  "What happens to given poses: refine (improve them by registering neighbouring "
                  "scans; their frame stays) or exact (use them as they are, and check them)")
      ->check(command_line::one_of({"refine", "exact"}));
  command.add_option(
      "--pose-time-offset", arguments.pose_time_offset,
      "SECONDS to add to the stamps of the given poses, or auto: estimate them from "
      "the scans' motion, which takes as long as odometry (default: only a warning)");
  command
      .add_option("--loops", arguments.loops,
                  "With odometry: close loops at places that were seen again, also between drives")
      ->capture_default_str()
      ->check(command_line::one_of({"on", "off"}));
  command
      .add_option("--register-to", options.register_to,
                  "Map package whose frame the new map gets: its scans are localized there and the "
                  "poses moved accordingly")
      ->check(command_line::existing_folder());
  command.add_option("--pose-sigma", arguments.pose_sigma,
                     "With odometry: the given poses are right to within METRES,DEGREES");
  command.add_option(
      "--gnss-sigma", options.trajectory.gnss_sigma_m,
      "With odometry: the positions of the given poses are right to within this [m]");
}

/// The range of the drives' sensors, if they share one and the command line gives none.
void set_range(const BuildArguments& arguments, const CLI::App& command, const char* option,
               std::optional<double> maps::SensorPreset::*of_sensor, double& range_m) {
  if (command.count(option) > 0) return;
  std::optional<double> range;
  for (std::size_t i = 0; i < arguments.drives.size(); ++i) {
    const maps::SensorPreset* sensor = maps::sensor_in_words(arguments.drives[i]);
    const std::optional<double> its = sensor == nullptr ? std::nullopt : sensor->*of_sensor;
    if (i > 0 && its != range)
      throw std::invalid_argument(fmt::format(
          "the sensors of these drives have different defaults for {0}; set {0}", option));
    range = its;
  }
  range_m = range.value_or(range_m);
}

void read_pose_time_offset(const std::string& word, mapping::MapBuildOptions& options) {
  options.finds_pose_time_offset = word == "auto";
  if (word.empty() || options.finds_pose_time_offset) return;
  const char* end = word.data() + word.size();
  const auto [parsed, error] = std::from_chars(word.data(), end, options.pose_time_offset_s);
  if (error != std::errc() || parsed != end || !(std::abs(options.pose_time_offset_s) <= 1e9))
    throw std::invalid_argument(fmt::format(
        "--pose-time-offset: '{}' is no offset; give seconds from -1e9 to 1e9, or auto", word));
}

}  // namespace

void require_unless_estimate(const CLI::App& command, const char* option) {
  if (command.count(option) == 0)
    throw std::invalid_argument(
        fmt::format("{} is missing; give {} FOLDER, or --estimate", option, option));
}

void resolve_options(BuildArguments& arguments, const CLI::App& command) {
  mapping::MapBuildOptions& options = arguments.options;
  options.selection = maps::Selection::parse(arguments.select);
  options.projection.policy = mapping::movable_policy_from(arguments.movable);
  const std::string clean = options.clean;
  if (arguments.preset == "paper") mapping::apply_paper_preset(options);
  set_range(arguments, command, "--min-range", &maps::SensorPreset::min_range_m,
            options.min_range_m);
  set_range(arguments, command, "--max-range", &maps::SensorPreset::max_range_m,
            options.max_range_m);
  options.trajectory.loops = arguments.loops == "on";
  if (!arguments.geo_origin.empty())
    options.geodetic_origin = command_line::parse_geo_origin(arguments.geo_origin);
  if (arguments.pose_sigma) {
    const auto [metres, degrees] =
        command_line::metres_and_degrees("--pose-sigma", *arguments.pose_sigma);
    options.trajectory.prior = {.sigma_m = metres, .sigma_rad = degrees * std::numbers::pi / 180};
  }
  read_pose_time_offset(arguments.pose_time_offset, options);
  const auto given = [&](const char* name) { return command.count(name) > 0; };
  if (given("--given-poses"))
    options.given_poses = arguments.given_poses == name_of(mapping::GivenPosesUse::kExact)
                              ? mapping::GivenPosesUse::kExact
                              : mapping::GivenPosesUse::kRefine;
  if (given("--fusion")) options.fusion = arguments.fusion == "on";
  if (given("--fill")) options.fill = arguments.fill == "on";
  if (given("--clean")) options.clean = clean;
  if (given("--ground-height"))
    options.projection.ground_height = mapping::ground_height_from(arguments.ground_height);
  if (options.edits_file && !options.fusion)
    throw std::invalid_argument(
        "--edits needs --fusion on (--preset paper turns it off); give --fusion on, or leave out "
        "--edits");
  if (given("--fill") && options.fill && !options.fills_ground())
    throw std::invalid_argument(
        "--fill on needs --fusion on and --movable project; give both, or leave out --fill");
}

void add_build_options(CLI::App& command, BuildArguments& arguments) {
  mapping::MapBuildOptions& options = arguments.options;
  arguments.movable = mapping::name_of(options.projection.policy);
  arguments.ground_height = mapping::name_of(options.projection.ground_height);
  command
      .add_option(
          "DRIVE", arguments.drives,
          "Drives: KITTI raw or odometry, MulRan, a key frame folder, a folder of .pcd, .ply or "
          ".bin "
          "scans, a dump of hdl_graph_slam, an MRPT rawlog, or a bag (MCAP, rosbag2, ROS 1, or a "
          "Velodyne's pcap). A bag "
          "with several topics: "
          "'FILE?cloud=TOPIC&poses=TOPIC&pose_frame=FRAME&gnss=TOPIC'. Several lidars as one: "
          "cloud=TOPIC,TOPIC, or a folder with lidars.json. Scans without times of points: "
          "'DRIVE?sensor=NAME' computes them (`stillmap inspect` suggests names). Registered "
          "scans, "
          "whose points lie in the frame of the poses: 'DRIVE?points=map'. Several "
          "drives become one map: by their poses if these share a frame, else by places that they "
          "share")
      ->required()
      ->check(command_line::existing_drive());
  command.add_option("--select", arguments.select, "Scans to use, begin:end:step as in Python")
      ->capture_default_str();
  command
      .add_option("--poses", options.poses_file,
                  "Poses to use instead of the drive's own: KITTI, TUM, CSV or g2o, T_map_lidar")
      ->check(command_line::existing_path());
  command.add_option("--geo-origin", arguments.geo_origin,
                     "LATITUDE,LONGITUDE,ALTITUDE [deg, deg, m above the WGS 84 ellipsoid] of the "
                     "origin of the given poses (x east, y north), if the drive does not say it");
  add_range_options(command, arguments);
  add_pose_options(command, arguments);
  command
      .add_option(
          "--detector", options.detector,
          "Detector of movable objects: geometric, voxelnext[:FILE], onnx:FILE (a network of "
          "your own, see mapping/onnx.md), or boxes:FILE with KITTI tracking labels or JSON "
          "(format stillmap-boxes; with several drives boxes:FILE,FILE...)")
      ->capture_default_str();
  command
      .add_option(
          "--movable", arguments.movable,
          "What happens to points of movable objects: project (onto the ground), delete or keep")
      ->capture_default_str()
      ->check(command_line::one_of({"project", "delete", "keep"}));
  add_method_options(command, arguments);
  command
      .add_option("--voxel", options.voxel_size_m,
                  "Edge of the voxels into which points are merged [m]")
      ->capture_default_str();
  command
      .add_option("--threads", options.threads,
                  "Threads; 0 = all cores. The map is the same with any number")
      ->capture_default_str();
}

void add_build(CLI::App& app) {
  auto asked = std::make_shared<BuildCommand>();
  CLI::App* command = app.add_subcommand("build", "Build a map package from drives");
  add_build_options(*command, asked->arguments);
  command
      ->add_option("-o,--output", asked->map,
                   "Folder of the map package to write; must not exist (required without "
                   "--estimate)")
      ->type_name("FOLDER");
  command->add_flag("--estimate", asked->estimate,
                    "Only print how much memory and disk space the build may need");
  add_unit_options(*command, asked->units,
                   "Do these units alone, with commas between: poses, survey:N, fuse, finish:N, "
                   "merge (N from 1 to --units). What they find goes to .NAME.units beside the "
                   "map");
  add_plan_option(*command, asked->units);
  add_progress_options(*command, asked->progress);
  asked->json.add_to(*command);
  command->callback([asked, command] { build(*asked, *command); });
}

}  // namespace stillmap::mapper
