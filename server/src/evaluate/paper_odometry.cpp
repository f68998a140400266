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
#include "command_line/progress_bar.hpp"
#include "command_line/run_program.hpp"
#include "command_line/table.hpp"
#include "command_line/text_file.hpp"
#include "evaluate/commands.hpp"
#include "evaluate/work_folder.hpp"

namespace stillmap::evaluate {
namespace {

using mapping::OdometryTable;
using mapping::OdometryTableRun;
using mapping::PathFigures;

struct TableArguments {
  std::optional<std::filesystem::path> work;
  std::optional<std::filesystem::path> json;
  std::optional<std::filesystem::path> report;
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
      throw std::invalid_argument(fmt::format(
          "{}: found with DRIVE or --kitti, expected simulated streets or these", simulated));
  }
  if (!arguments.options.kitti && command.count("--sequences") > 0)
    throw std::invalid_argument("--sequences: found without --kitti, expected both");
}

void evaluate(TableArguments& arguments, const CLI::App& command) {
  check(arguments, command);
  // Two builds of one version may differ in what they make.
  arguments.options.program = STILLMAP_VERSION " " + maps::sha256_of_file("/proc/self/exe");
  OdometryTable table;
  {
    const WorkFolder work(arguments.work);
    command_line::ProgressBar bar;
    table = mapping::evaluate_odometry_table(
        arguments.options, simulate_table_drive, work.path(), work.keep(),
        [&bar](std::string_view stage, std::size_t done, std::size_t total) {
          bar.update("table", done, total, stage);
        },
        command_line::cancel_flag());
  }
  print_for_people(table);
  if (arguments.report)
    command_line::write_text_file(*arguments.report,
                                  mapping::to_html(table, command_line::command_of(command)));
  if (!arguments.json) return;
  auto json = nlohmann::ordered_json::parse(mapping::to_json(table));
  json["version"] = STILLMAP_VERSION;
  command_line::write_text_file(*arguments.json, json.dump(2) + "\n");
}

void add_drives(CLI::App& command, mapping::OdometryTableOptions& options) {
  command
      .add_option("DRIVE", options.drives,
                  "Drives with true poses (default: town streets are simulated)")
      ->check(command_line::existing_folder());
  command
      .add_option("--kitti", options.kitti,
                  "Folder of KITTI odometry: sequences/NN/velodyne/, sequences/NN/calib.txt, "
                  "poses/NN.txt")
      ->check(command_line::existing_folder());
  command
      .add_option("--sequences", options.sequences,
                  "Of --kitti (default: those of 00, 05, 07 and 08 that are there)")
      ->delimiter(',');
  command
      .add_option("--seeds", options.seeds,
                  "Town streets to simulate, a seed each; fewer than three say little of others")
      ->delimiter(',')
      ->capture_default_str();
  command.add_option("--scans", options.scans, "Scans of each simulated street")
      ->capture_default_str();
  command
      .add_option("--sensor", options.sensor,
                  "hdl64, os1-64, os1-128, vlp16, or a file that describes one")
      ->capture_default_str();
  command.add_option("--parked", options.parked_share,
                     "Share of the parking places along simulated streets that are taken, 0 to 1 "
                     "(default: the town's own)");
}

}  // namespace

void add_paper_odometry(CLI::App& evaluate_command) {
  auto arguments = std::make_shared<TableArguments>();
  mapping::OdometryTableOptions& options = arguments->options;
  CLI::App* command = evaluate_command.add_subcommand(
      "paper-odometry",
      "The paper's Table I: how far odometry is off with raw, projected and deleted points, with "
      "and without loops");
  add_drives(*command, options);
  command->add_option("--detector", options.detector, "What finds movable objects, as for build")
      ->capture_default_str();
  command->add_option("--methods", options.methods, "How scans are followed")
      ->delimiter(',')
      ->capture_default_str()
      ->check(CLI::IsMember(mapping::odometry_names()));
  command
      ->add_option("--threads", options.threads,
                   "Threads; 0 = all cores. The figures do not depend on it")
      ->capture_default_str();
  command->add_option("--work", arguments->work,
                      "Keep drives and results there, and go on with what is there already");
  command->add_option("--json", arguments->json, "Write the result there")
      ->check(command_line::in_existing_folder());
  command->add_option("--report", arguments->report, "Write a page with diagrams (HTML) there")
      ->check(command_line::in_existing_folder());
  command->callback([arguments, command] { evaluate(*arguments, *command); });
}

}  // namespace stillmap::evaluate
