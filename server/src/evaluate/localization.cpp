#include <stillmap/mapping/localization_evaluation.hpp>
#include <stillmap/mapping/localization_report.hpp>
#include <stillmap/mapping/reference.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/map_package.hpp>

#include <fmt/core.h>

#include <cmath>
#include <initializer_list>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "command_line/command_text.hpp"
#include "command_line/option_value.hpp"
#include "command_line/progress_bar.hpp"
#include "command_line/result_output.hpp"
#include "command_line/run_program.hpp"
#include "command_line/text_file.hpp"
#include "evaluate/commands.hpp"

namespace stillmap::evaluate {
namespace {

struct LocalizationArguments {
  std::filesystem::path map;
  std::filesystem::path drive;
  std::optional<std::filesystem::path> poses;
  std::string select = "::";
  std::vector<std::string> prior_errors;
  std::optional<std::string> prior_sigma;
  std::string method = mapping::map_aligner_names().front();
  command_line::JsonOutput json;
  std::optional<std::filesystem::path> csv;
  command_line::ReportOutput report;
  mapping::LocalizationEvaluationOptions options;
};

mapping::PriorError read_prior_error(const std::string& option, const std::string& text) {
  const auto [metres, degrees] = command_line::metres_and_degrees(option, text);
  return {.metres = metres, .degrees = degrees};
}

/// An option whose words are the names of an enumeration's values.
template <typename Value>
void add_choice(CLI::App& command, const std::string& name, Value& chosen,
                std::initializer_list<Value> values, const std::string& help) {
  std::map<std::string, Value> by_name;
  std::vector<std::string> names;
  for (const Value value : values) {
    by_name.emplace(name_of(value), value);
    names.emplace_back(name_of(value));
  }
  command
      .add_option_function<std::string>(
          name, [&chosen, by_name](const std::string& word) { chosen = by_name.at(word); }, help)
      ->default_str(std::string(name_of(chosen)))
      ->check(command_line::one_of(names));
}

std::string to_json_text(const mapping::LocalizationEvaluation& evaluation,
                         const LocalizationArguments& arguments) {
  auto json = nlohmann::ordered_json::parse(mapping::to_json(evaluation));
  json["version"] = STILLMAP_VERSION;
  json["options"]["map"] = arguments.map.string();
  json["options"]["drive"] = arguments.drive.string();
  json["options"]["select"] = arguments.select;
  json["options"]["poses"] = arguments.poses ? nlohmann::ordered_json(arguments.poses->string())
                                             : nlohmann::ordered_json(nullptr);
  json["options"]["method"] = arguments.method;
  return json.dump(2);
}

std::string text_of(const mapping::PriorError& error) {
  if (std::isnan(error.metres)) return "no prior";
  return fmt::format("{:.3g} m {:.3g} deg", error.metres, error.degrees);
}

std::string text_of(const mapping::BoundedRate& rate) {
  if (rate.of == 0) return "none to count";
  return fmt::format("{} of {} (< {:.2g} %)", rate.count, rate.of, 100 * rate.upper_95);
}

double percent_of(std::uint64_t part, std::uint64_t whole) {
  return whole == 0 ? 0.0 : 100.0 * static_cast<double>(part) / static_cast<double>(whole);
}

/// The root mean squares that the paper reports, and whether protection levels hold.
void print_integrity(const mapping::LocalizationEvaluation& evaluation) {
  constexpr const char* kRow = "{:>14} {:>10} {:>10} {:>24} {:>24} {:>12} {:>12}\n";
  fmt::print("\n");
  fmt::print(fmt::runtime(kRow), "prior off by", "rmse x-y", "rmse yaw", "misleading (95 %)",
             "hazardous (95 %)", "available", "level/error");
  for (const mapping::LocalizationLevel& level : evaluation.levels) {
    const mapping::Integrity& integrity = level.integrity;
    fmt::print(fmt::runtime(kRow), text_of(level.prior_error),
               fmt::format("{:.1f} cm", 100 * level.translation_m.rmse_part),
               fmt::format("{:.2f} deg", level.rotation_deg.rmse_part),
               text_of(integrity.misleading), text_of(integrity.hazardous),
               fmt::format("{:.1f} %", 100 * integrity.availability.rate),
               fmt::format("{:.1f}", integrity.level_over_error));
  }
}

void print_for_people(const mapping::LocalizationEvaluation& evaluation) {
  fmt::print("{:>14} {:>8} {:>22} {:>18} {:>9} {:>20} {:>20} {:>10}\n", "prior off by", "queries",
             "success (95 %)", "ok/degraded/lost", "false ok", "error median, 95 %",
             "turn median, 95 %", "ms median");
  for (const mapping::LocalizationLevel& level : evaluation.levels) {
    fmt::print("{:>14} {:>8} {:>22} {:>18} {:>9} {:>20} {:>20} {:>10}\n",
               text_of(level.prior_error), level.queries,
               fmt::format("{:.2f} % ({:.1f}-{:.1f})", 100 * level.success_rate,
                           100 * level.success_interval[0], 100 * level.success_interval[1]),
               fmt::format("{}/{}/{}", level.ok, level.degraded, level.lost),
               fmt::format("{:.2f} %", 100 * level.false_ok_rate),
               fmt::format("{:.1f}, {:.1f} cm", 100 * level.translation_m.median,
                           100 * level.translation_m.p95),
               fmt::format("{:.2f}, {:.2f} deg", level.rotation_deg.median, level.rotation_deg.p95),
               fmt::format("{:.1f}", level.wall_ms.p50));
  }
  print_integrity(evaluation);
  if (const mapping::QueryPoints& points = evaluation.points;
      evaluation.options.query_movable != mapping::MovablePolicy::kKeep) {
    fmt::print("{:.1f} % of the points of the scans were projected, {:.1f} % deleted\n",
               percent_of(points.projected, points.in), percent_of(points.deleted, points.in));
  }
  fmt::print("{} scans in {:.1f} s\n", evaluation.scans, evaluation.seconds);
}

/// The drive, with poses to compare with.
maps::Drive open_drive(LocalizationArguments& arguments) {
  if (!arguments.poses) return maps::Drive::open(arguments.drive);
  maps::Drive own = maps::Drive::open(arguments.drive);
  auto reference = maps::poses_of_some_scans(own, *arguments.poses);
  if (!reference) return maps::Drive::open(arguments.drive, arguments.poses);
  arguments.options.reference = std::move(*reference);
  return own;
}

void evaluate(LocalizationArguments& arguments, const CLI::App& command) {
  mapping::LocalizationEvaluationOptions& options = arguments.options;
  options.selection = maps::Selection::parse(arguments.select);
  if (!arguments.prior_errors.empty()) options.prior_errors.clear();
  if (!arguments.prior_errors.empty() && options.prior != mapping::PriorSource::kDrawn) {
    throw std::invalid_argument(
        fmt::format("--prior-error has no effect with --prior {}; leave one of them out, or give "
                    "--prior drawn",
                    name_of(options.prior)));
  }
  if (arguments.prior_sigma)
    options.prior_sigma = read_prior_error("--prior-sigma", *arguments.prior_sigma);
  for (const std::string& text : arguments.prior_errors)
    options.prior_errors.push_back(read_prior_error("--prior-error", text));
  if (command.count("--query-detector") > 0 &&
      options.query_movable == mapping::MovablePolicy::kKeep) {
    throw std::invalid_argument(
        "--query-detector has no effect with --query-movable keep; leave it out, or give "
        "--query-movable delete or project");
  }
  const auto map = maps::MapPackage::open(arguments.map);
  const maps::Drive drive = open_drive(arguments);
  mapping::LocalizationEvaluation evaluation;
  {
    command_line::ProgressBar bar;
    evaluation = mapping::evaluate_localization(
        *map, drive, options,
        [&](const maps::MapPackage& package) {
          return mapping::make_map_aligner(arguments.method, package);
        },
        [&bar](std::string_view stage, std::size_t done, std::size_t total) {
          bar.update(stage, done, total);
        },
        command_line::cancel_flag());
  }
  if (!arguments.json.replaces_text()) print_for_people(evaluation);
  if (arguments.csv) command_line::write_text_file(*arguments.csv, mapping::to_csv(evaluation));
  if (arguments.report.is_asked()) {
    arguments.report.write(
        mapping::to_html(evaluation, {.map = arguments.map.string(),
                                      .drive = arguments.drive.string(),
                                      .method = arguments.method,
                                      .command = command_line::command_of(command)}),
        arguments.json);
  }
  if (arguments.json.is_asked()) arguments.json.write(to_json_text(evaluation, arguments));
}

}  // namespace

void add_localization(CLI::App& evaluate_command) {
  auto arguments = std::make_shared<LocalizationArguments>();
  mapping::LocalizationEvaluationOptions& options = arguments->options;
  CLI::App* command = evaluate_command.add_subcommand(
      "localization",
      "Localize a drive's scans in a map and compare the answers with the drive's poses");
  command->add_option("MAP", arguments->map, "Folder of the map package")
      ->required()
      ->check(command_line::existing_folder());
  command->add_option("DRIVE", arguments->drive, "Drive with poses: its folder or its bag")
      ->required()
      ->check(command_line::existing_drive());
  command
      ->add_option("--poses", arguments->poses,
                   "Poses to use instead of the drive's own: KITTI, TUM, CSV or g2o, T_map_lidar. "
                   "Where a TUM "
                   "file has poses of some scans only, only these scans are localized")
      ->check(command_line::existing_path());
  command
      ->add_option("--select", arguments->select, "Scans to localize, begin:end:step as in Python")
      ->capture_default_str();
  command
      ->add_option(
          "--prior-error", arguments->prior_errors,
          fmt::format("METRES,DEGREES by which each prior is wrong; may be given several times "
                      "(default {:g},{:g})",
                      options.prior_errors.front().metres, options.prior_errors.front().degrees))
      ->allow_extra_args(false);
  command->add_option(
      "--prior-sigma", arguments->prior_sigma,
      "METRES,DEGREES to send as each prior's standard deviations, for example 20,180 for GNSS "
      "(default: none are sent)");
  command->add_option("--trials", options.trials, "Priors drawn for each scan")
      ->capture_default_str();
  command
      ->add_option("--seed", options.seed,
                   "Seed of the drawn priors; every method gets the same ones")
      ->capture_default_str();
  command
      ->add_option("--threads", options.threads,
                   "Threads; 0 = all cores. With more, each query takes longer")
      ->capture_default_str();
  command
      ->add_option("--method", arguments->method,
                   "Alignment method; a program built with -DSTILLMAP_REFERENCE=ON also has PCL's")
      ->capture_default_str()
      ->check(command_line::one_of(mapping::map_aligner_names()));
  add_choice(
      *command, "--prior", options.prior,
      {mapping::PriorSource::kDrawn, mapping::PriorSource::kPrevious, mapping::PriorSource::kNone},
      "Where each search starts: drawn (at the true pose plus --prior-error), previous (at the "
      "true pose of the scan before) or none (the whole map is searched)");
  add_choice(*command, "--bias", options.bias,
             {mapping::BiasCorrection::kFit, mapping::BiasCorrection::kNone},
             "A constant difference between the drive's poses and the map: fit (estimate and "
             "subtract it) or none (count it as error, where the poses are the truth)");
  add_choice(
      *command, "--query-deskew", options.query_deskew,
      {mapping::QueryDeskew::kVehicle, mapping::QueryDeskew::kMap, mapping::QueryDeskew::kNone},
      "How scans are deskewed: vehicle (with the velocity from the poses), map (by the method, "
      "from the times of the points) or none");
  add_choice(*command, "--query-movable", options.query_movable,
             {mapping::MovablePolicy::kKeep, mapping::MovablePolicy::kDelete,
              mapping::MovablePolicy::kProject},
             "What happens to points of movable objects in the scans: keep, delete, or project "
             "(onto the ground of that scan)");
  command
      ->add_option("--query-detector", options.query_detector,
                   "Detector for --query-movable: geometric, voxelnext[:FILE] or boxes:FILE")
      ->capture_default_str();
  arguments->json.add_to(*command);
  command->add_option("--csv", arguments->csv, "Write one line for each query to FILE, as CSV")
      ->check(command_line::in_existing_folder());
  arguments->report.add_to(*command);
  command->callback([arguments, command] { evaluate(*arguments, *command); });
}

}  // namespace stillmap::evaluate
