#include <fmt/format.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/package_delta.hpp>
#include <stillmap/maps/partial_file.hpp>

#include <fstream>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "bodies/maps_json.hpp"
#include "command_line/result_output.hpp"
#include "command_line/run_program.hpp"
#include "command_line/table.hpp"
#include "commands.hpp"
#include "store/package_archive.hpp"

namespace stillmap::cli {
namespace {

struct DeltaCommand {
  std::filesystem::path from, to;
  std::optional<std::filesystem::path> tar;
  command_line::JsonOutput json;
};

void write_tar(const DeltaCommand& asked) {
  server::PackageArchive archive(asked.to, asked.from);
  maps::PartialFile file(*asked.tar);
  std::ofstream out(file.path(), std::ios::binary);
  std::vector<char> buffer(std::size_t{1} << 20U);
  for (std::uint64_t at = 0; at < archive.size();) {
    const std::size_t got = archive.read(at, buffer);
    out.write(buffer.data(), static_cast<std::streamsize>(got));
    at += got;
  }
  out.close();
  if (!out)
    throw maps::StorageError(asked.tar->string(), "cannot be written: look at the disk's room");
  file.publish();
}

void print_delta(const DeltaCommand& asked) {
  const auto from = maps::MapPackage::open(asked.from), to = maps::MapPackage::open(asked.to);
  const maps::PackageDelta delta = maps::package_delta(from->manifest(), to->manifest());
  if (asked.tar) write_tar(asked);
  asked.json.write(server::delta_json(from->digest(), to->digest(), delta));
  if (asked.json.replaces_text()) return;
  using command_line::grouped;
  command_line::Table table;
  table.add("from", from->digest());
  table.add("to", to->digest());
  table.add("missing",
            fmt::format("{} of {} bytes, {} of {} files", grouped(delta.missing_bytes),
                        grouped(delta.bytes), delta.missing.size(), to->manifest().files.size()));
  for (const auto& [path, file] : delta.missing) table.add("  " + path, grouped(file.bytes));
  if (asked.tar) table.add("written", asked.tar->string());
  table.print();
}

}  // namespace

void add_delta(CLI::App& app) {
  auto asked = std::make_shared<DeltaCommand>();
  CLI::App* command = app.add_subcommand(
      "delta", "Say which files of a map version are missing where another version lies");
  command->add_option("FROM", asked->from, "Map package that is there")
      ->required()
      ->check(command_line::existing_folder());
  command->add_option("TO", asked->to, "Map package that is wanted")
      ->required()
      ->check(command_line::existing_folder());
  command
      ->add_option("-o,--output", asked->tar,
                   "Write manifest.json and the missing files as a tar, for an upload to a store "
                   "that has the other version")
      ->type_name("FILE");
  asked->json.add_to(*command);
  command->callback([asked] { print_delta(*asked); });
}

}  // namespace stillmap::cli
