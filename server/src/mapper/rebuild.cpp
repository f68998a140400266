#include <stillmap/mapping/build_estimate.hpp>
#include <stillmap/mapping/rebuild.hpp>
#include <stillmap/mapping/reference.hpp>

#include <fmt/core.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>

#include "command_line/progress_bar.hpp"
#include "command_line/result_output.hpp"
#include "command_line/run_program.hpp"
#include "command_line/table.hpp"
#include "mapper/build_arguments.hpp"
#include "mapper/commands.hpp"
#include "mapper/progress_output.hpp"
#include "mapper/units.hpp"

namespace stillmap::mapper {
namespace {

struct RebuildCommand {
  BuildArguments build;
  std::filesystem::path map;
  std::filesystem::path work;
  command_line::JsonOutput json;
  std::optional<std::filesystem::path> gate;
  bool estimate = false;
  ProgressArguments progress;
  UnitArguments units;
  mapping::RebuildOptions options;
};

mapping::RebuildOptions read_options(RebuildCommand& asked, const CLI::App& command) {
  resolve_options(asked.build, command);
  mapping::RebuildOptions options = asked.options;
  options.drives = asked.build.drives;
  options.map = asked.map;
  options.work = asked.work;
  options.build = asked.build.options;
  if (options.held_back && command.count("--held-back-every") > 0)
    throw std::invalid_argument(
        "--held-back-every has no effect with --held-back; leave one of them out");
  if (asked.gate) options.limits = mapping::read_gate_limits(*asked.gate);
  return options;
}

std::string text_of(const mapping::HeldBackAnswers& answers) {
  return fmt::format("{} of {} found; {} ok, {} degraded, {} lost", answers.found, answers.queries,
                     answers.ok, answers.degraded, answers.lost);
}

void print_for_people(const mapping::RebuildResult& result, const RebuildCommand& asked) {
  command_line::Table table;
  table.add("map", asked.map.string());
  table.add("digest", result.digest);
  if (const auto& patch = result.patch) {
    table.add("new tiles",
              fmt::format("{} of {}", command_line::grouped(patch->tiles_new),
                          command_line::grouped(patch->tiles_new + patch->tiles_kept)));
    table.add("new bytes", fmt::format("{} of {}", command_line::grouped(patch->bytes_new),
                                       command_line::grouped(patch->bytes)));
    table.add("worst seam", fmt::format("{:.3f} m at {:.1f} {:.1f} {:.1f}", patch->worst_seam_m,
                                        patch->worst_seam_at_map.x(), patch->worst_seam_at_map.y(),
                                        patch->worst_seam_at_map.z()));
  }
  table.add("held-back scans", text_of(result.answers));
  table.add("  in the keep map", text_of(result.keep_answers));
  if (result.previous_answers)
    table.add("  in the previous version", text_of(*result.previous_answers));
  table.add("peak memory", fmt::format("{:.0f} MiB", result.peak_rss_mib));
  table.add("gate", result.verdict.passed ? "passed" : "not passed");
  table.print();
  for (const mapping::GateCheck& check : result.verdict.checks)
    fmt::print("{} {}\n", check.passed ? "pass:" : "FAIL:", check.words);
  for (const std::string& warning : result.warnings) fmt::print("warning: {}\n", warning);
}

void print_estimate(const mapping::RebuildEstimate& estimate,
                    const command_line::JsonOutput& json) {
  json.write(mapping::to_json(estimate));
  if (json.replaces_text()) return;
  command_line::Table table;
  table.add("scans", command_line::grouped(estimate.scans));
  table.add("map package", command_line::grouped(estimate.package_bytes) + " bytes at most");
  table.add("work folder", command_line::grouped(estimate.work_bytes) + " bytes at most");
  table.print();
}

/// One unit of a package, as a job of `--executor slurm` does it: `map/survey:3`.
void do_unit(const RebuildCommand& asked, const mapping::RebuildOptions& options) {
  const std::size_t end = asked.units.list.find('/');
  const std::string part = asked.units.list.substr(0, end);
  const std::vector<mapping::BuildUnit> units = mapping::units_from(
      end == std::string::npos ? part : asked.units.list.substr(end + 1), asked.units.units);
  command_line::say_when_cancelled(command_line::goes_on_from(options.work));
  run_with_progress(asked.progress, stages_of(units, options.previous.has_value()),
                    [&](const mapping::ProgressCallback& progress) {
                      for (const mapping::BuildUnit& unit : units)
                        (void)mapping::do_rebuild_unit(options, part, unit, asked.units.units,
                                                       under_unit(unit, progress),
                                                       command_line::cancel_flag());
                    });
  fmt::print("done: {}\n", asked.units.list);
}

/// Packages by jobs in Slurm, if that is asked for.
mapping::PackageMaker package_maker(const RebuildCommand& asked,
                                    const mapping::RebuildOptions& options,
                                    const CLI::App& command) {
  if (!asked.units.executor.is_slurm()) return {};
  mapping::require_usable_by_units(options.build, asked.units.units);
  SlurmBuild build{
      .target = {},
      .command = unit_command(command, {"--json"}),
      .prefix = {},
      .units = asked.units.units,
      .threads = options.build.threads,
      .memory_bytes = mapping::estimate_build(options.drives, options.build).memory_bytes,
      .options = asked.units.executor.slurm_options};
  return [build](const std::string& part, const std::filesystem::path& target,
                 const mapping::ProgressCallback& progress) mutable {
    build.target = target;
    build.prefix = part + "/";
    (void)build_in_slurm(build, progress, command_line::cancel_flag());
  };
}

void rebuild(RebuildCommand& asked, const CLI::App& command) {
  const mapping::RebuildOptions options = read_options(asked, command);
  require_usable(asked.units);
  if (asked.estimate) return print_estimate(mapping::estimate_rebuild(options), asked.json);
  for (const char* option : {"--output", "--work"}) require_unless_estimate(command, option);
  if (!asked.units.list.empty()) return do_unit(asked, options);
  const mapping::PackageMaker make_package = package_maker(asked, options, command);
  command_line::say_when_cancelled(command_line::goes_on_from(options.work));
  mapping::RebuildResult result;
  run_with_progress(asked.progress, mapping::rebuild_stages(options),
                    [&](const mapping::ProgressCallback& progress) {
                      result = mapping::rebuild_map(options, progress, command_line::cancel_flag(),
                                                    mapping::make_reference_cleaner, make_package);
                      auto json = nlohmann::ordered_json::parse(mapping::to_json(result, options));
                      json["version"] = STILLMAP_VERSION;
                      asked.json.write(json.dump(2));
                    });
  if (!asked.json.replaces_text()) print_for_people(result, asked);
  if (!result.verdict.passed) throw command_line::ExitCode{exit_code::kGateNotPassed};
}

}  // namespace

void add_rebuild(CLI::App& app) {
  auto asked = std::make_shared<RebuildCommand>();
  mapping::RebuildOptions& options = asked->options;
  CLI::App* command = app.add_subcommand(
      "rebuild", "Build a new version of a map and judge it against the active one");
  command->footer(
      "Exit codes: 0 the map was made and passed the gate, 4 the map was made and did not pass,\n"
      "1 failed, 2 wrong usage, 3 disk full, 130 cancelled.");
  add_build_options(*command, asked->build);
  command
      ->add_option("-o,--output", asked->map,
                   "Folder of the map package to write; must not exist (required without "
                   "--estimate)")
      ->type_name("FOLDER");
  command
      ->add_option("--work", asked->work,
                   "Folder that keeps finished stages, on the map's file system: a later call goes "
                   "on from there (required without --estimate)")
      ->type_name("FOLDER");
  command->add_option("--previous", options.previous, "Map package of the active version")
      ->check(command_line::existing_folder());
  command->add_flag("--patch", options.patch,
                    "Keep all of --previous but the tiles that the drives saw");
  command
      ->add_option("--held-back", options.held_back,
                   "Another drive of the same streets, with poses, to judge the map by")
      ->check(command_line::existing_drive());
  command
      ->add_option("--held-back-every", options.held_back_every,
                   "Without --held-back: every n-th scan stays out of the map, to judge it by")
      ->capture_default_str()
      ->check(CLI::Range(std::size_t{2}, std::size_t{1000}));
  command
      ->add_option("--gate", asked->gate, "Limits of the gate that replace the usual ones (JSON)")
      ->check(command_line::existing_file());
  command->add_flag("--estimate", asked->estimate,
                    "Only print how much disk space the rebuild needs");
  asked->json.add_to(*command);
  add_unit_options(*command, asked->units,
                   "Do a unit of a map in --work alone, as the jobs of --executor slurm do: "
                   "map/UNIT or keep/UNIT, and UNIT is poses, survey:N, fuse, finish:N or merge");
  add_progress_options(*command, asked->progress);
  command->callback([asked, command] { rebuild(*asked, *command); });
}

}  // namespace stillmap::mapper
