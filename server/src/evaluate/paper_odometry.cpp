#include <stillmap/mapping/odometry.hpp>
#include <stillmap/mapping/odometry_table.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/simulation/simulate.hpp>

#include <fmt/format.h>

#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>

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

using mapping::OdometryTable;
using mapping::OdometryTableRun;
using mapping::PathFigures;

struct TableArguments {
  std::optional<std::filesystem::path> work;
  command_line::JsonOutput json;
  command_line::ReportOutput report;
  mapping::OdometryTableOptions options;
};

void simulate_table_drive(const mapping::OdometryTableOptions& options, std::uint64_t seed,
                          const std::filesystem::path& target,
                          const mapping::ProgressCallback& progress,
                          const mapping::CancelFlag& cancel) {
  simulation::SimulationOptions simulated;
  simulated.scenario = "town";
  simulated.seed = seed;
  simulated.sensor = options.sensor;
  simulated.scans = options.scans;
  simulated.parked_share = options.parked_share;
  simulated.threads = options.threads;
  (void)simulation::simulate_drive(target, simulated, progress, cancel);
}

constexpr const char* kRow = "{:<10} {:<10} {:<6} {:>9} {:>9} {:>10} {:>12} {:>9} {:>16}\n";

void print_path(const OdometryTableRun& run, bool loops, const PathFigures& figures) {
  const std::string found =
      loops ? fmt::format("{} of {} right", run.loops_right, run.loops_found) : "";
  fmt::print(fmt::runtime(kRow), run.method, mapping::points_name(run.points), loops ? "on" : "off",
             command_line::number_text(figures.ape_mean_m, 3),
             command_line::number_text(figures.ate_rmse_m, 3),
             command_line::number_text(figures.kitti_percent, 3),
             command_line::number_text(figures.kitti_deg_per_100m, 4),
             command_line::number_text(figures.percent_10m, 3), found);
}

void print_drive(const OdometryTable& table, const mapping::OdometryTableDrive& drive) {
  fmt::print("{}, {} scans, {:.0f} m\n", drive.name, drive.scans, drive.way_m);
  fmt::print(fmt::runtime(kRow), "odometry", "points", "loops", "APE [m]", "ATE [m]", "KITTI [%]",
             "[deg/100 m]", "10 m [%]", "loops");
  fmt::print(fmt::runtime(kRow), "given", "", "", "0.000", "0.000", "0.000", "0.0000", "0.000", "");
  for (const OdometryTableRun& run : table.runs) {
    if (run.drive != drive.name) continue;
    print_path(run, false, run.without_loops);
    print_path(run, true, run.with_loops);
  }
  if (drive.paper_m)
    fmt::print("the paper prints {:.2f} m without removal, {:.2f} m for its method\n",
               drive.paper_m->at(0), drive.paper_m->at(1));
  fmt::print("\n");
}

std::string text_of(const mapping::Interval& interval, int digits) {
  if (!std::isfinite(interval.low))
    return std::isfinite(interval.value) ? fmt::format("{:+.{}f}", interval.value, digits) : "-";
  return fmt::format("{:+.{}f} ({:+.{}f} to {:+.{}f})", interval.value, digits, interval.low,
                     digits, interval.high, digits);
}

void print_differences(const OdometryTable& table) {
  constexpr const char* kDifference = "{:<10} {:<18} {:<6} {:>28} {:>28} {:>10}\n";
  fmt::print("Less than zero: better than raw points. 95 % intervals over the drives\n");
  fmt::print(fmt::runtime(kDifference), "odometry", "points", "loops", "APE [m]", "10 m [%]",
             "better in");
  for (const mapping::OdometryTableDifference& each : table.differences)
    fmt::print(fmt::runtime(kDifference), each.method, mapping::points_name(each.points) + " - raw",
               each.loops ? "on" : "off", text_of(each.ape_mean_m, 3), text_of(each.percent_10m, 3),
               fmt::format("{} of {}", each.better, each.drives));
}

void print_for_people(const OdometryTable& table) {
  for (const mapping::OdometryTableDrive& drive : table.drives) print_drive(table, drive);
  print_differences(table);
  fmt::print(
      "\nAPE: mean distance, ATE: root mean square, after the best rigid motion without scale. -: "
      "the drive is\nshorter than a segment. Given poses are the truth here.\n");
  if (!table.missing.empty()) fmt::print("Not in the folder: {}\n", fmt::join(table.missing, ", "));
  fmt::print("{} {} in {:.1f} s\n", table.drives.size(),
             table.drives.size() == 1 ? "drive" : "drives", table.seconds);
}

void check(const TableArguments& arguments, const CLI::App& command) {
  const bool given = !arguments.options.drives.empty() || arguments.options.kitti;
  for (const char* simulated : {"--seeds", "--scans", "--sensor", "--parked"}) {
    if (given && command.count(simulated) > 0)
      throw std::invalid_argument(
          fmt::format("{} is for simulated streets and has no effect with DRIVE or --kitti; leave "
                      "one of them out",
                      simulated));
  }
  if (!arguments.options.kitti && command.count("--sequences") > 0)
    throw std::invalid_argument(
        "--sequences has no effect without --kitti; give --kitti FOLDER too");
}

void evaluate(TableArguments& arguments, const CLI::App& command) {
  check(arguments, command);
  // Two builds of one version may differ in what they make.
  arguments.options.program = STILLMAP_VERSION " " + maps::sha256_of_file("/proc/self/exe");
  OdometryTable table;
  {
    const WorkFolder work(arguments.work);
    work.say_when_cancelled();
    command_line::ProgressBar bar;
    table = mapping::evaluate_odometry_table(
        arguments.options, simulate_table_drive, work.path(), work.keep(),
        [&bar](std::string_view stage, std::size_t done, std::size_t total) {
          bar.update("table", done, total, stage);
        },
        command_line::cancel_flag());
  }
  if (!arguments.json.replaces_text()) print_for_people(table);
  if (arguments.report.is_asked())
    arguments.report.write(mapping::to_html(table, command_line::command_of(command)),
                           arguments.json);
  if (!arguments.json.is_asked()) return;
  auto json = nlohmann::ordered_json::parse(mapping::to_json(table));
  json["version"] = STILLMAP_VERSION;
  arguments.json.write(json.dump(2));
}

void add_drives(CLI::App& command, mapping::OdometryTableOptions& options) {
  command
      .add_option("DRIVE", options.drives,
                  "Drives with true poses (default: simulated town streets)")
      ->check(command_line::existing_folder());
  command
      .add_option("--kitti", options.kitti,
                  "Folder of KITTI odometry: sequences/NN/velodyne/, sequences/NN/calib.txt, "
                  "poses/NN.txt")
      ->check(command_line::existing_folder());
  command
      .add_option(
          "--sequences", options.sequences,
          "Sequences of --kitti to use (default: those of 00, 05, 07 and 08 that are there)")
      ->delimiter(',');
  command
      .add_option("--seeds", options.seeds,
                  "Seeds of the town streets to simulate, one street each; three or more are "
                  "needed for useful intervals")
      ->delimiter(',')
      ->capture_default_str();
  command.add_option("--scans", options.scans, "Number of scans in each simulated street")
      ->capture_default_str();
  command
      .add_option("--sensor", options.sensor,
                  "Sensor: hdl64, os1-64, os1-128, vlp16, or a file that describes one")
      ->capture_default_str();
  command.add_option("--parked", options.parked_share,
                     "Share of parking places with a car along simulated streets, 0 to 1 "
                     "(default: the town's own)");
}

}  // namespace

void add_paper_odometry(CLI::App& evaluate_command) {
  auto arguments = std::make_shared<TableArguments>();
  mapping::OdometryTableOptions& options = arguments->options;
  CLI::App* command = evaluate_command.add_subcommand(
      "paper-odometry",
      "Table I of the paper: errors of odometry on raw, projected and deleted points, with and "
      "without loops");
  add_drives(*command, options);
  command
      ->add_option("--detector", options.detector,
                   "Detector of movable objects, named as for build")
      ->capture_default_str();
  command->add_option("--methods", options.methods, "Odometry methods")
      ->delimiter(',')
      ->capture_default_str()
      ->check(command_line::one_of(mapping::odometry_names()));
  command
      ->add_option("--threads", options.threads,
                   "Threads; 0 = all cores. The figures are the same with any number")
      ->capture_default_str();
  command
      ->add_option("--work", arguments->work,
                   "Folder that keeps drives and results; a later call goes on from there "
                   "(default: a temporary one)")
      ->type_name("FOLDER");
  arguments->json.add_to(*command);
  arguments->report.add_to(*command);
  command->callback([arguments, command] { evaluate(*arguments, *command); });
}

}  // namespace stillmap::evaluate
