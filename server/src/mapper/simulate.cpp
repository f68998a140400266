#include <stillmap/simulation/simulate.hpp>

#include <fmt/core.h>

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "command_line/progress_bar.hpp"
#include "command_line/run_program.hpp"
#include "command_line/table.hpp"
#include "mapper/commands.hpp"

namespace stillmap::mapper {
namespace {

using command_line::grouped;

struct SimulateArguments {
  std::filesystem::path drive;
  simulation::SimulationOptions options;
  /// 6 numbers, or none.
  std::vector<double> mount;
};

void simulate(const SimulateArguments& arguments) {
  simulation::SimulationResult result;
  {
    command_line::ProgressBar bar;
    result = simulation::simulate_drive(
        arguments.drive, arguments.options,
        [&bar](std::string_view stage, std::size_t done, std::size_t total) {
          bar.update(stage, done, total);
        },
        command_line::cancel_flag());
  }
  command_line::Table table;
  table.add("drive", arguments.drive.string());
  table.add("scans", fmt::format("{} over {:.1f} m", result.scans, result.distance_m));
  table.add("points", fmt::format("{} of {} rays", grouped(result.points), grouped(result.rays)));
  table.add("objects", fmt::format("{} parked, {} moving", result.parked, result.moving));
  const double casting_seconds = std::max(result.seconds - result.world_seconds, 1e-9);
  table.add("time", fmt::format("{:.1f} s for the world, then {:.1f} scans/s", result.world_seconds,
                                static_cast<double>(result.scans) / casting_seconds));
  table.add("peak memory", fmt::format("{:.0f} MiB", result.peak_rss_mib));
  table.print();
}

}  // namespace

void add_simulate(CLI::App& app) {
  auto arguments = std::make_shared<SimulateArguments>();
  simulation::SimulationOptions& options = arguments->options;
  CLI::App* command =
      app.add_subcommand("simulate", "Simulate a drive, with the ground truth beside it");
  command
      ->add_option("SCENARIO", options.scenario,
                   "World to drive through: town, city, highway or depot")
      ->capture_default_str();
  command
      ->add_option("-o,--output", arguments->drive, "Folder of the drive to write; must not exist")
      ->type_name("FOLDER")
      ->required();
  command->add_option("--seed", options.seed, "Seed of the world: another seed makes another world")
      ->capture_default_str();
  command
      ->add_option("--day", options.day,
                   "Day in this world: another day has other parked cars and other traffic")
      ->capture_default_str();
  command->add_option("--parked", options.parked_share,
                      "Share of parking places with a car along the roads, 0 to 1 "
                      "(default: the scenario's own)");
  command->add_flag("--change", options.change,
                    "Change the world: new building sites, and some fences removed");
  command->add_flag("--standing", options.standing,
                    "Keep the sensor in one place beside the lane, with traffic passing");
  command
      ->add_option("--carrier", options.carrier,
                   "What carries the sensor: vehicle, fast (a vehicle at twice the speed on rough "
                   "ground) or hand (a person who looks around)")
      ->capture_default_str();
  command->add_flag("--imu", options.imu,
                    "Also write the readings of an IMU, imu.csv (layout pcd)");
  command
      ->add_option("--sensor", options.sensor,
                   "Sensor: hdl64, os1-64, os1-128, vlp16, avia, or a file that describes one")
      ->capture_default_str();
  command
      ->add_option(
          "--mount", arguments->mount,
          "Where the lidar is mounted, from its usual place: X,Y,Z in m, ROLL,PITCH,YAW in "
          "degrees; for drives of several lidars of one vehicle, with --layout pcd")
      ->type_name("X,Y,Z,ROLL,PITCH,YAW")
      ->delimiter(',')
      ->expected(6);
  command->add_option("--phase", options.phase_s, "How much later each scan is taken, in seconds")
      ->capture_default_str();
  command
      ->add_option("--scans", options.scans,
                   "Number of scans, about ten a second: up to 10000, in a city up to 100000")
      ->capture_default_str();
  command
      ->add_option("--first", options.first,
                   "Write a part of a longer drive: the number of its first scan, from 0")
      ->capture_default_str();
  command->add_option("--of", options.of,
                      "Scans of the whole drive that this is a part of (default: up to the last "
                      "scan of the part)");
  command
      ->add_option("--every", options.every,
                   "Write every N-th scan only, for queries that are spread over a long drive")
      ->capture_default_str();
  command
      ->add_option("--layout", options.layout,
                   "Layout of the drive: kitti-odometry, kitti-raw or pcd")
      ->capture_default_str();
  command->add_flag("--truth", options.truth,
                    "Also write what only a simulator knows: time of each point, true ground, "
                    "hidden points");
  command
      ->add_option("--threads", options.threads,
                   "Threads; 0 = all cores. The drive is the same with any number")
      ->capture_default_str();
  command->callback([arguments] {
    std::copy(arguments->mount.begin(), arguments->mount.end(), arguments->options.mount.begin());
    simulate(*arguments);
  });
}

}  // namespace stillmap::mapper
