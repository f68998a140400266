#include <stillmap/mapping/rebuild.hpp>

#include <fmt/core.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>

#include "command_line/progress_bar.hpp"
#include "command_line/run_program.hpp"
#include "command_line/table.hpp"
#include "mapper/build_arguments.hpp"
#include "mapper/commands.hpp"
#include "mapper/progress_output.hpp"
#include "reference/cleaners.hpp"

namespace stillmap::mapper {
namespace {

struct RebuildCommand {
  BuildArguments build;
  std::filesystem::path map;
  std::filesystem::path work;
  std::filesystem::path report;
  std::optional<std::filesystem::path> gate;
  bool estimate = false;
  ProgressArguments progress;
  mapping::RebuildOptions options;
};

mapping::RebuildOptions read_options(RebuildCommand& asked, const CLI::App& command) {
  read_words(asked.build, command);
  mapping::RebuildOptions options = asked.options;
  options.drives = asked.build.drives;
  options.map = asked.map;
  options.work = asked.work;
  options.build = asked.build.options;
  if (options.held_back && command.count("--held-back-every") > 0)
    throw std::invalid_argument(
        "--held-back-every: found beside --held-back, expected one of them");
  if (asked.gate) options.limits = mapping::read_gate_limits(*asked.gate);
  return options;
}

void require(const CLI::App& command, const char* option) {
  if (command.count(option) == 0)
    throw std::invalid_argument(fmt::format("{}: found nothing, expected a path", option));
}

std::string text_of(const mapping::HeldBackAnswers& answers) {
  return fmt::format("{} of {} found; {} ok, {} degraded, {} lost", answers.found, answers.queries,
                     answers.ok, answers.degraded, answers.lost);
}

void print_for_people(const mapping::RebuildReport& report, const RebuildCommand& asked) {
  command_line::Table table;
  table.add("map", asked.map.string());
  table.add("digest", report.digest);
  table.add("held-back scans", text_of(report.answers));
  table.add("  in the keep map", text_of(report.keep_answers));
  if (report.previous_answers)
    table.add("  in the previous version", text_of(*report.previous_answers));
  table.add("peak memory", fmt::format("{:.0f} MiB", report.peak_rss_mib));
  table.add("gate", report.verdict.passed ? "passed" : "not passed");
  table.print();
  for (const mapping::GateCheck& check : report.verdict.checks)
    fmt::print("{} {}\n", check.passed ? "pass:" : "FAIL:", check.words);
  for (const std::string& warning : report.warnings) fmt::print("warning: {}\n", warning);
}

void rebuild(RebuildCommand& asked, const CLI::App& command) {
  const mapping::RebuildOptions options = read_options(asked, command);
  if (asked.estimate) {
    fmt::print("{}\n", mapping::to_json(mapping::estimate_rebuild(options)));
    return;
  }
  for (const char* option : {"--output", "--work", "--report"}) require(command, option);
  mapping::RebuildReport report;
  run_with_progress(asked.progress, mapping::rebuild_stages(options),
                    [&](const mapping::ProgressCallback& progress) {
                      report = mapping::rebuild_map(options, progress, command_line::cancel_flag(),
                                                    mapping::make_reference_cleaner);
                      auto json = nlohmann::ordered_json::parse(mapping::to_json(report, options));
                      json["version"] = STILLMAP_VERSION;
                      command_line::write_text_file(asked.report, json.dump(2) + "\n");
                    });
  print_for_people(report, asked);
}

}  // namespace

void add_rebuild(CLI::App& app) {
  auto asked = std::make_shared<RebuildCommand>();
  mapping::RebuildOptions& options = asked->options;
  CLI::App* command = app.add_subcommand(
      "rebuild", "Make a new version of a map and judge it against the one before");
  add_build_options(*command, asked->build);
  command->add_option("-o,--output", asked->map, "Map package to write; must not exist");
  command->add_option(
      "--work", asked->work,
      "Folder of its own in which finished stages are remembered, on the map's file "
      "system");
  command->add_option("--previous", options.previous, "The version that is in use")
      ->check(command_line::existing_folder());
  command
      ->add_option("--held-back", options.held_back,
                   "Another drive of the same streets, with poses, to judge the map by")
      ->check(command_line::existing_drive());
  command
      ->add_option("--held-back-every", options.held_back_every,
                   "Without one: every n-th scan stays out of the map, to judge it by")
      ->capture_default_str()
      ->check(CLI::Range(std::size_t{2}, std::size_t{1000}));
  command->add_option("--gate", asked->gate, "Limits other than the usual ones (JSON)")
      ->check(command_line::existing_file());
  command->add_option("--report", asked->report, "Write figures and verdict there (JSON)")
      ->check(command_line::in_existing_folder());
  command->add_flag("--estimate", asked->estimate,
                    "Only print what it would need on the disk, in bytes (JSON)");
  add_progress_options(*command, asked->progress);
  command->callback([asked, command] { rebuild(*asked, *command); });
}

}  // namespace stillmap::mapper
