#include <stillmap/mapping/localization_evaluation.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/map_package.hpp>

#include <fmt/core.h>

#include <charconv>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "command_line/progress_bar.hpp"
#include "command_line/run_program.hpp"
#include "mapper/commands.hpp"
#include "reference/map_aligners.hpp"

namespace stillmap::mapper {
namespace {

struct EvaluateArguments {
  std::filesystem::path map;
  std::filesystem::path drive;
  std::optional<std::filesystem::path> poses;
  std::string select = "::";
  std::vector<std::string> prior_errors;
  std::string method = mapping::map_aligner_names().front();
  std::string prior = "drawn";
  std::optional<std::filesystem::path> json;
  mapping::LocalizationEvaluationOptions options;
};

mapping::PriorError read_prior_error(const std::string& text) {
  mapping::PriorError error;
  const char* const end = text.data() + text.size();
  const auto [comma, metres_error] = std::from_chars(text.data(), end, error.metres);
  const bool has_comma = metres_error == std::errc{} && comma != end && *comma == ',';
  if (has_comma) {
    const auto [last, degrees_error] = std::from_chars(comma + 1, end, error.degrees);
    if (degrees_error == std::errc{} && last == end) return error;
  }
  throw std::invalid_argument("--prior-error: found '" + text + "', expected METRES,DEGREES");
}

/// Leaves the prior that is drawn for each scan aside.
class WithoutPrior : public localization::Aligner {
 public:
  explicit WithoutPrior(std::unique_ptr<localization::Aligner> aligner)
      : aligner_(std::move(aligner)) {}

  [[nodiscard]] localization::AlignmentResult align(
      const maps::PointCloud& scan_lidar,
      const std::optional<localization::Prior>& /*prior*/) const override {
    return aligner_->align(scan_lidar, std::nullopt);
  }

 private:
  std::unique_ptr<localization::Aligner> aligner_;
};

std::unique_ptr<localization::Aligner> make_aligner(const EvaluateArguments& arguments,
                                                    const maps::MapPackage& map) {
  std::unique_ptr<localization::Aligner> aligner = mapping::make_map_aligner(arguments.method, map);
  if (arguments.prior == "none") return std::make_unique<WithoutPrior>(std::move(aligner));
  return aligner;
}

std::string to_json_text(const mapping::LocalizationEvaluation& evaluation,
                         const EvaluateArguments& arguments) {
  auto json = nlohmann::ordered_json::parse(mapping::to_json(evaluation));
  json["version"] = STILLMAP_VERSION;
  json["options"]["map"] = arguments.map.string();
  json["options"]["drive"] = arguments.drive.string();
  json["options"]["select"] = arguments.select;
  json["options"]["poses"] = arguments.poses ? nlohmann::ordered_json(arguments.poses->string())
                                             : nlohmann::ordered_json(nullptr);
  json["options"]["method"] = arguments.method;
  json["options"]["prior"] = arguments.prior;
  return json.dump(2) + "\n";
}

void print_for_people(const mapping::LocalizationEvaluation& evaluation) {
  fmt::print("{:>14} {:>8} {:>22} {:>18} {:>9} {:>20} {:>20} {:>10}\n", "prior off by", "queries",
             "success (95 %)", "ok/degraded/lost", "false ok", "error median, 95 %",
             "turn median, 95 %", "ms median");
  for (const mapping::LocalizationLevel& level : evaluation.levels) {
    fmt::print("{:>14} {:>8} {:>22} {:>18} {:>9} {:>20} {:>20} {:>10}\n",
               fmt::format("{:g} m {:g} deg", level.prior_error.metres, level.prior_error.degrees),
               level.queries,
               fmt::format("{:.2f} % ({:.1f}-{:.1f})", 100 * level.success_rate,
                           100 * level.success_interval[0], 100 * level.success_interval[1]),
               fmt::format("{}/{}/{}", level.ok, level.degraded, level.lost),
               fmt::format("{:.2f} %", 100 * level.false_ok_rate),
               fmt::format("{:.1f}, {:.1f} cm", 100 * level.translation_m.median,
                           100 * level.translation_m.p95),
               fmt::format("{:.2f}, {:.2f} deg", level.rotation_deg.median, level.rotation_deg.p95),
               fmt::format("{:.1f}", level.wall_ms.p50));
  }
  fmt::print("{} scans in {:.1f} s\n", evaluation.scans, evaluation.seconds);
}

/// The drive, with poses to compare with.
maps::Drive open_drive(EvaluateArguments& arguments) {
  if (!arguments.poses) return maps::Drive::open(arguments.drive);
  maps::Drive own = maps::Drive::open(arguments.drive);
  auto reference = maps::poses_of_some_scans(own, *arguments.poses);
  if (!reference) return maps::Drive::open(arguments.drive, arguments.poses);
  arguments.options.reference = std::move(*reference);
  return own;
}

void evaluate(EvaluateArguments& arguments) {
  mapping::LocalizationEvaluationOptions& options = arguments.options;
  options.selection = maps::Selection::parse(arguments.select);
  if (!arguments.prior_errors.empty()) options.prior_errors.clear();
  for (const std::string& text : arguments.prior_errors)
    options.prior_errors.push_back(read_prior_error(text));
  // Without priors there is nothing to draw.
  if (arguments.prior == "none") {
    options.prior_errors = {{.metres = 0.0, .degrees = 0.0}};
    options.trials = 1;
  }
  const auto map = maps::MapPackage::open(arguments.map);
  const maps::Drive drive = open_drive(arguments);
  mapping::LocalizationEvaluation evaluation;
  {
    command_line::ProgressBar bar;
    evaluation = mapping::evaluate_localization(
        *map, drive, options,
        [&](const maps::MapPackage& package) { return make_aligner(arguments, package); },
        [&bar](std::string_view stage, std::size_t done, std::size_t total) {
          bar.update(stage, done, total);
        },
        command_line::cancel_flag());
  }
  print_for_people(evaluation);
  if (arguments.json) write_text_file(*arguments.json, to_json_text(evaluation, arguments));
}

}  // namespace

void add_evaluate_localization(CLI::App& evaluate_command) {
  auto arguments = std::make_shared<EvaluateArguments>();
  mapping::LocalizationEvaluationOptions& options = arguments->options;
  CLI::App* command = evaluate_command.add_subcommand(
      "localization",
      "Ask for the poses of a drive's scans from priors that are off, and compare with its poses");
  command->add_option("MAP", arguments->map, "Map package")
      ->required()
      ->check(command_line::existing_folder());
  command->add_option("DRIVE", arguments->drive, "Drive with poses")
      ->required()
      ->check(command_line::existing_folder());
  command
      ->add_option("--poses", arguments->poses,
                   "Poses instead of the drive's own: KITTI or TUM, T_map_lidar. Of a TUM file "
                   "made of some of the scans, only these are asked for")
      ->check(command_line::existing_file());
  command
      ->add_option("--select", arguments->select, "Scans to ask for, begin:end:step as in Python")
      ->capture_default_str();
  command
      ->add_option(
          "--prior-error", arguments->prior_errors,
          fmt::format("METRES,DEGREES that each prior is off by; may be given several times "
                      "(default {:g},{:g})",
                      options.prior_errors.front().metres, options.prior_errors.front().degrees))
      ->allow_extra_args(false);
  command->add_option("--trials", options.trials, "Priors drawn for each scan")
      ->capture_default_str();
  command->add_option("--seed", options.seed, "Same seed, same priors, whatever the method")
      ->capture_default_str();
  command
      ->add_option("--threads", options.threads,
                   "Threads; 0 = all cores. More make the times longer")
      ->capture_default_str();
  command->add_option("--method", arguments->method, "Alignment method")
      ->capture_default_str()
      ->check(CLI::IsMember(mapping::map_aligner_names()));
  command
      ->add_option("--prior", arguments->prior,
                   "drawn: as --prior-error says; none: the whole map is searched")
      ->capture_default_str()
      ->check(CLI::IsMember({"drawn", "none"}));
  command->add_option("--json", arguments->json, "Write the result there")
      ->check(command_line::in_existing_folder());
  command->callback([arguments] { evaluate(*arguments); });
}

}  // namespace stillmap::mapper
