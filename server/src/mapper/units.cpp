#include "mapper/units.hpp"

#include <fmt/format.h>

#include <stdexcept>

#include "command_line/command_text.hpp"
#include "command_line/run_program.hpp"
#include "command_line/text_file.hpp"
#include "mapper/slurm_jobs.hpp"

namespace stillmap::mapper {
namespace {

using Kind = mapping::BuildUnit::Kind;

bool is_of(const std::string& stage, Kind kind) {
  const bool is_survey = stage == "survey";
  const bool is_later = stage == "place" || stage == "tiles" || stage == "publish";
  switch (kind) {
    case Kind::kPoses:
      return !is_survey && !is_later && stage != "resume" && stage != "fuse";
    case Kind::kSurvey:
      return is_survey || stage == "resume";
    case Kind::kFuse:
      return stage == "resume" || stage == "fuse";
    case Kind::kFinish:
      return stage == "place" || stage == "tiles";
    case Kind::kMerge:
      return is_later;
  }
  return false;
}

}  // namespace

void add_unit_options(CLI::App& command, UnitArguments& arguments, const char* unit_help) {
  auto* units =
      command
          .add_option("--units", arguments.units,
                      "Shares that scans and map are cut into; the map is the same with any number")
          ->check(CLI::Range(std::size_t{1}, mapping::kMostUnits))
          ->group(kUnitGroup);
  command.add_option("--unit", arguments.list, unit_help)->needs(units)->group(kUnitGroup);
  add_executor_options(command, arguments.executor);
}

void add_plan_option(CLI::App& command, UnitArguments& arguments) {
  command
      .add_option("--plan", arguments.plan,
                  "Build nothing; write the commands of all units to this file, an "
                  "empty line between steps")
      ->check(command_line::in_existing_folder())
      ->needs(command.get_option("--units"))
      ->excludes(command.get_option("--unit"))
      ->group(kUnitGroup);
}

void require_usable(const UnitArguments& arguments) {
  const bool in_slurm = arguments.executor.is_slurm();
  if (in_slurm && arguments.units == 0)
    throw std::invalid_argument(
        "--executor slurm: found without --units; give the number of shares, two to four times "
        "that of the machines");
  if (in_slurm && !(arguments.list.empty() && arguments.plan.empty()))
    throw std::invalid_argument(
        "--executor slurm: found with --unit or --plan; leave out one of them");
  if (!in_slurm && !arguments.executor.slurm_options.empty())
    throw std::invalid_argument(
        "--slurm-option has no effect without --executor slurm; leave it out");
  require_usable_options(arguments.executor.slurm_options);
  if (arguments.units > 0 && !in_slurm && arguments.list.empty() && arguments.plan.empty())
    throw std::invalid_argument(
        "--units: found without --unit, --plan and --executor slurm; give one of them, or leave "
        "out --units");
}

std::vector<mapping::BuildUnit> units_to_do(const UnitArguments& arguments) {
  require_usable(arguments);
  if (arguments.list.empty()) return {};
  return mapping::units_from(arguments.list, arguments.units);
}

void write_plan(const UnitArguments& arguments, const mapping::MapBuildOptions& options,
                const CLI::App& command) {
  mapping::require_usable_by_units(options, arguments.units);
  const std::string build = fmt::format(
      "cd {} && {} build{}", command_line::shell_word(std::filesystem::current_path().string()),
      command_line::shell_word(command_line::program_name()),
      command_line::words_of(command, "--plan"));
  std::string text;
  for (const std::vector<mapping::BuildUnit>& step : mapping::unit_steps(arguments.units)) {
    if (!text.empty()) text += '\n';
    for (const mapping::BuildUnit& unit : step)
      text += fmt::format("{} --unit {}\n", build, name_of(unit));
  }
  command_line::write_text_file(arguments.plan, text);
}

mapping::ProgressCallback under_unit(const mapping::BuildUnit& unit,
                                     const mapping::ProgressCallback& progress) {
  return [name = name_of(unit), progress](std::string_view stage, std::size_t done,
                                          std::size_t total) {
    progress(fmt::format("{}: {}", name, stage), done, total);
  };
}

std::vector<mapping::StageShare> stages_of(const std::vector<mapping::BuildUnit>& units,
                                           bool registers) {
  std::vector<mapping::StageShare> stages;
  for (const mapping::BuildUnit& unit : units) {
    for (const mapping::StageShare& each : mapping::build_stages(registers)) {
      if (is_of(each.stage, unit.kind))
        stages.push_back({fmt::format("{}: {}", name_of(unit), each.stage), each.share});
    }
  }
  return stages;
}

}  // namespace stillmap::mapper
