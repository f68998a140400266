#include <stillmap/maps/map_export.hpp>
#include <stillmap/maps/map_package.hpp>

#include <fmt/core.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "command_line/run_program.hpp"
#include "command_line/table.hpp"
#include "commands.hpp"
#include "json/export_json.hpp"

namespace stillmap::cli {
namespace {

using maps::PointKind;

struct ExportArguments {
  std::filesystem::path map, out;
  std::string format;
  std::vector<PointKind> without;
  bool json = false;
};

void export_map(const ExportArguments& arguments) {
  command_line::cancel_on_signals();
  maps::MapExportOptions options;
  options.without.insert(arguments.without.begin(), arguments.without.end());
  options.work.threads = std::max(1U, std::thread::hardware_concurrency());
  options.work.go_on = [](double) { return !command_line::cancel_flag(); };
  maps::MapExportReport report;
  try {
    report = maps::export_map(*maps::MapPackage::open(arguments.map), arguments.format,
                              arguments.out, options);
  } catch (const maps::WorkStopped&) {
    throw command_line::ExitCode{command_line::kCancelled};
  }
  if (arguments.json) return fmt::print("{}\n", server::export_json(arguments.format, report));
  command_line::Table table;
  table.add("written", arguments.out.string());
  table.add("points", command_line::grouped(report.points));
  table.add("files", command_line::grouped(report.files));
  table.add("bytes", command_line::grouped(report.bytes));
  table.print();
}

}  // namespace

void add_export(CLI::App& app) {
  auto arguments = std::make_shared<ExportArguments>();
  CLI::App* command = app.add_subcommand("export", "Write a map for other programs");
  std::map<std::string, std::string> formats;
  std::string listed = "Formats:";
  for (const maps::MapExportFormat& format : maps::map_export_formats()) {
    formats.emplace(format.name, format.name);
    listed += fmt::format("\n  {:<10} {}", format.name, format.description);
  }
  command->footer(listed);
  command->add_option("MAP", arguments->map, "Map package")
      ->required()
      ->check(command_line::existing_folder());
  command->add_option("--format", arguments->format, "One of those below")
      ->required()
      ->check(CLI::IsMember(formats));
  command->add_option("-o,--output", arguments->out, "What to write; must not exist")->required();
  const std::map<std::string, PointKind> kinds = {{"measured", PointKind::kMeasured},
                                                  {"ground", PointKind::kGround},
                                                  {"projected", PointKind::kProjected},
                                                  {"filled", PointKind::kFilled}};
  command
      ->add_option("--without", arguments->without,
                   "Kinds of points to leave out: measured, ground, projected (moved down from "
                   "objects), filled (synthetic ground)")
      ->delimiter(',')
      ->transform(CLI::Transformer(kinds))
      ->type_name("KIND,...");
  command->add_flag("--json", arguments->json, "Print JSON");
  command->callback([arguments] { export_map(*arguments); });
}

}  // namespace stillmap::cli
