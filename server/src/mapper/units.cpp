#include "mapper/units.hpp"

#include <fmt/format.h>

#include <stdexcept>

#include "command_line/command_text.hpp"
#include "command_line/run_program.hpp"
#include "command_line/text_file.hpp"

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

void add_unit_options(CLI::App& command, UnitArguments& arguments) {
  const std::string group = "One build by several processes";
  command
      .add_option("--units", arguments.units,
                  "Shares that scans and map are cut into; the map is the same with any number")
      ->check(CLI::Range(std::size_t{1}, mapping::kMostUnits))
      ->group(group);
  auto* unit =
      command
          .add_option("--unit", arguments.list,
                      "Do these units alone, with commas between: poses, survey:N, fuse, finish:N, "
                      "merge (N from 1 to --units). What they find goes to .NAME.units beside the "
                      "map")
          ->group(group);
  auto* plan = command
                   .add_option("--plan", arguments.plan,
                               "Build nothing; write the commands of all units to this file, an "
                               "empty line between steps")
                   ->check(command_line::in_existing_folder())
                   ->group(group);
  for (CLI::Option* option : {unit, plan}) option->needs(command.get_option("--units"));
  plan->excludes(unit);
}

std::vector<mapping::BuildUnit> units_to_do(const UnitArguments& arguments) {
  if (!arguments.list.empty()) return mapping::units_from(arguments.list, arguments.units);
  if (arguments.units > 0 && arguments.plan.empty())
    throw std::invalid_argument(
        "--units: found without --unit and --plan; give one of them, or leave out --units");
  return {};
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
