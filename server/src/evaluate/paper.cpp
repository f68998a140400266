#include <stillmap/mapping/paper_evaluation.hpp>
#include <stillmap/mapping/reference.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/simulation/simulate.hpp>

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "command_line/command_text.hpp"
#include "command_line/option_value.hpp"
#include "command_line/progress_bar.hpp"
#include "command_line/result_output.hpp"
#include "command_line/run_program.hpp"
#include "evaluate/commands.hpp"
#include "evaluate/work_folder.hpp"

namespace stillmap::evaluate {
namespace {

struct PaperArguments {
  std::vector<std::filesystem::path> drives;
  std::optional<std::filesystem::path> work;
  command_line::JsonOutput json;
  command_line::ReportOutput report;
  mapping::PaperEvaluationOptions options;
};

void simulate_paper_drive(const mapping::PaperEvaluationOptions& options,
                          mapping::PaperParts::StreetDay street,
                          const std::filesystem::path& target,
                          const mapping::ProgressCallback& progress,
                          const mapping::CancelFlag& cancel) {
  simulation::SimulationOptions simulated;
  simulated.scenario = "town";
  simulated.seed = street.seed;
  simulated.day = street.day;
  simulated.sensor = options.sensor;
  simulated.scans = options.scans;
  simulated.parked_share = options.parked_share;
  simulated.threads = options.threads;
  (void)simulation::simulate_drive(target, simulated, progress, cancel);
}

mapping::PaperParts parts() {
  return {.simulate = simulate_paper_drive,
          .make_aligner = mapping::make_map_aligner,
          .make_cleaner = mapping::make_reference_cleaner,
          .cleaners = mapping::reference_cleaner_names()};
}

std::string text_of(const mapping::Interval& interval, double scale, const char* form) {
  const std::string number = fmt::format("{{:{0}}} ({{:{0}}} to {{:{0}}})", form);
  return fmt::format(fmt::runtime(number), scale * interval.value, scale * interval.low,
                     scale * interval.high);
}

constexpr double kCentimetres = 100.0;
constexpr double kDegrees = 180.0 / std::numbers::pi;

std::string title_of(const std::string& method, const std::string& query) {
  return fmt::format("{}, scans {}", method,
                     query == "raw" ? "as they are" : "without movable objects");
}

void print_rows(const mapping::PaperEvaluation& evaluation) {
  constexpr const char* kRow = "{:<12} {:>22} {:>26} {:>8} {:>22} {:>9} {:>6} {:>6}\n";
  std::string title;
  for (const mapping::PaperRow& row : evaluation.rows) {
    if (title != title_of(row.method, row.query)) {
      title = title_of(row.method, row.query);
      fmt::print("{}{}\n", &row == &evaluation.rows.front() ? "" : "\n", title);
      fmt::print(fmt::runtime(kRow), "map", "rmse x-y [cm]", "rmse yaw [rad]", "[deg]",
                 "success [%]", "degraded", "lost", "of");
    }
    fmt::print(fmt::runtime(kRow), row.map, text_of(row.rmse_xy_m, kCentimetres, ".2f"),
               text_of(row.rmse_yaw_rad, 1.0, ".5f"),
               fmt::format("{:.3f}", row.rmse_yaw_rad.value * kDegrees),
               text_of(row.success_rate, 100.0, ".1f"), row.degraded, row.lost, row.queries);
  }
}

void print_differences(const mapping::PaperEvaluation& evaluation) {
  constexpr const char* kRow = "{:<42} {:>20} {:>26} {:>8} {:>32} {:>8}\n";
  if (evaluation.differences.empty()) return;
  fmt::print("\nLess than zero: the first map is better\n");
  fmt::print(fmt::runtime(kRow), "method and scans", "maps", "rmse x-y [cm]", "streets",
             "rmse yaw [rad]", "streets");
  for (const mapping::PaperDifference& each : evaluation.differences)
    fmt::print(fmt::runtime(kRow), title_of(each.method, each.query),
               fmt::format("{} - {}", each.map, each.against),
               text_of(each.rmse_xy_m, kCentimetres, "+.2f"),
               fmt::format("{}/{}", each.better_xy, each.streets),
               text_of(each.rmse_yaw_rad, 1.0, "+.5f"),
               fmt::format("{}/{}", each.better_yaw, each.streets));
}

void print_for_people(const mapping::PaperEvaluation& evaluation) {
  print_rows(evaluation);
  print_differences(evaluation);
  fmt::print(
      "\nRMSE over all scans, lost ones with the error of their prior; 95 % intervals by drawing "
      "streets and blocks of scans.\n{} scans of {} streets in {:.1f} s\n",
      evaluation.scans, evaluation.streets.size(), evaluation.seconds);
}

/// Two builds of one version may differ in what they make.
std::string this_program() { return STILLMAP_VERSION " " + maps::sha256_of_file("/proc/self/exe"); }

void read_drives(PaperArguments& arguments, const CLI::App& command) {
  const std::vector<std::filesystem::path>& drives = arguments.drives;
  if (drives.empty()) return;
  if (drives.size() % 2 != 0)
    throw std::invalid_argument(fmt::format(
        "--drives: {} drives are no pairs; give for each map drive the drive to localize in it",
        drives.size()));
  for (const char* simulated : {"--seeds", "--scans", "--sensor", "--parked"}) {
    if (command.count(simulated) > 0)
      throw std::invalid_argument(
          fmt::format("{} is for simulated streets and has no effect with --drives; leave one of "
                      "them out",
                      simulated));
  }
  arguments.options.seeds.clear();
  for (std::size_t i = 0; i < drives.size(); i += 2)
    arguments.options.drives.push_back({drives[i], drives[i + 1]});
}

void evaluate(PaperArguments& arguments, const CLI::App& command) {
  read_drives(arguments, command);
  arguments.options.program = this_program();
  mapping::PaperEvaluation evaluation;
  {
    const WorkFolder work(arguments.work);
    work.say_when_cancelled();
    command_line::ProgressBar bar;
    evaluation = mapping::evaluate_paper(
        arguments.options, parts(), work.path(), work.keep(),
        [&bar](std::string_view stage, std::size_t done, std::size_t total) {
          bar.update("paper", done, total, stage);
        },
        command_line::cancel_flag());
  }
  if (!arguments.json.replaces_text()) print_for_people(evaluation);
  if (arguments.report.is_asked())
    arguments.report.write(mapping::to_html(evaluation, command_line::command_of(command)),
                           arguments.json);
  if (!arguments.json.is_asked()) return;
  auto json = nlohmann::ordered_json::parse(mapping::to_json(evaluation));
  json["version"] = STILLMAP_VERSION;
  arguments.json.write(json.dump(2));
}

void add_streets(CLI::App& command, PaperArguments& arguments) {
  mapping::PaperEvaluationOptions& options = arguments.options;
  command
      .add_option("--seeds", options.seeds,
                  "Seeds of the town streets to simulate, one street each; three or more are "
                  "needed for useful intervals")
      ->delimiter(',')
      ->capture_default_str();
  command.add_option("--scans", options.scans, "Number of scans on each day of a simulated street")
      ->capture_default_str();
  command
      .add_option("--sensor", options.sensor,
                  "Sensor: hdl64, os1-64, os1-128, vlp16, avia, or a file that describes one")
      ->capture_default_str();
  command.add_option("--parked", options.parked_share,
                     "Share of parking places with a car along simulated streets, 0 to 1 "
                     "(default: the town's own)");
  command
      .add_option("--drives", arguments.drives,
                  "Drives to use instead of simulated streets: MAP_DRIVE QUERY_DRIVE, or several "
                  "such pairs, with true poses in one frame")
      ->check(command_line::existing_drive());
}

}  // namespace

void add_paper(CLI::App& evaluate_command) {
  auto arguments = std::make_shared<PaperArguments>();
  mapping::PaperEvaluationOptions& options = arguments->options;
  CLI::App* command = evaluate_command.add_subcommand(
      "paper",
      "Table II of the paper: build maps of one day in several ways, and localize the scans of "
      "another day in them");
  add_streets(*command, *arguments);
  command
      ->add_option("--detector", options.detector,
                   "Detector of movable objects on both days: geometric, or boxes (the drives' own "
                   "boxes.json)")
      ->capture_default_str();
  command
      ->add_option(
          "--maps", options.maps,
          fmt::format(
              "Maps to compare (default all): {}",
              fmt::join(mapping::paper_map_names(mapping::reference_cleaner_names()), ", ")))
      ->delimiter(',')
      ->check(command_line::one_of(mapping::paper_map_names(mapping::reference_cleaner_names())));
  command->add_option("--methods", options.methods, "Alignment methods")
      ->delimiter(',')
      ->capture_default_str()
      ->check(command_line::one_of(mapping::map_aligner_names()));
  command
      ->add_option("--threads", options.threads,
                   "Threads; 0 = all cores. The figures are the same with any number")
      ->capture_default_str();
  command
      ->add_option("--work", arguments->work,
                   "Folder that keeps drives, maps and answers; a later call goes on from there "
                   "(default: a temporary one)")
      ->type_name("FOLDER");
  arguments->json.add_to(*command);
  arguments->report.add_to(*command);
  command->callback([arguments, command] { evaluate(*arguments, *command); });
}

}  // namespace stillmap::evaluate
