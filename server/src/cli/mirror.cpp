#include <fmt/format.h>

#include <chrono>
#include <cstdlib>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "blobs/blob_place.hpp"
#include "command_line/progress_bar.hpp"
#include "command_line/result_output.hpp"
#include "command_line/run_program.hpp"
#include "command_line/table.hpp"
#include "commands.hpp"
#include "mirror/map_mirror.hpp"

namespace stillmap::cli {
namespace {

constexpr const char* kKeyVariable = "STILLMAP_KEY";

struct MirrorCommand {
  std::string url;
  std::string vehicle;
  std::filesystem::path store;
  server::MirrorOptions options;
  std::optional<double> megabytes_a_second, most_megabytes;
  std::optional<double> every_s;
  std::filesystem::path trusted;
  std::vector<double> around;
  command_line::JsonOutput json;
};

std::optional<std::uint64_t> bytes_of(const std::optional<double>& megabytes) {
  if (!megabytes) return std::nullopt;
  return static_cast<std::uint64_t>(1e6 * *megabytes);
}

void print(const server::MirrorResult& result, const MirrorCommand& asked) {
  asked.json.write(nlohmann::ordered_json{{"version", result.version},
                                          {"digest", result.digest},
                                          {"regions", result.regions},
                                          {"is_new", result.is_new},
                                          {"bytes", result.bytes},
                                          {"bytes_fetched", result.bytes_fetched}}
                       .dump(2));
  if (asked.json.replaces_text()) return;
  command_line::Table table;
  table.add("map", asked.options.map + "/" + result.version);
  table.add("digest", result.digest);
  if (asked.options.around) table.add("regions", std::to_string(result.regions));
  table.add("fetched", result.is_new ? fmt::format("{} of {} bytes",
                                                   command_line::grouped(result.bytes_fetched),
                                                   command_line::grouped(result.bytes))
                                     : std::string("nothing: it was here"));
  table.print();
}

/// @return false when it was cancelled.
bool mirror_once(const MirrorCommand& asked, server::PackageStore& store,
                 server::MirrorSource& source) {
  command_line::ProgressBar bar;
  const auto result = server::mirror_map(
      store, source, asked.options,
      [&](std::uint64_t done, std::uint64_t total) { bar.update("mirror", done, total); },
      command_line::cancel_flag());
  if (result) print(*result, asked);
  return result.has_value();
}

void mirror(MirrorCommand& asked) {
  asked.options.bytes_a_second = bytes_of(asked.megabytes_a_second);
  asked.options.most_bytes = bytes_of(asked.most_megabytes);
  if (!asked.around.empty())
    asked.options.around = {{asked.around.at(0), asked.around.at(1)}, asked.around.at(2)};
  if (!asked.trusted.empty()) asked.options.trusted = server::read_public_keys(asked.trusted);
  const char* const key = std::getenv(kKeyVariable);
  const auto source = server::http_source(asked.url, key == nullptr ? "" : key, asked.vehicle);
  server::PackageStore::make_folder(asked.store);
  server::PackageStore store = server::open_store(asked.store);
  command_line::cancel_on_signals();
  command_line::say_when_cancelled(command_line::goes_on_from(asked.store));
  while (mirror_once(asked, store, *source) && asked.every_s) {
    const auto next =
        std::chrono::steady_clock::now() + std::chrono::duration<double>(*asked.every_s);
    while (!command_line::cancel_flag() && std::chrono::steady_clock::now() < next)
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    if (command_line::cancel_flag()) break;
  }
  if (command_line::cancel_flag()) throw command_line::ExitCode{exit_code::kCancelled};
}

}  // namespace

void add_mirror(CLI::App& app) {
  auto asked = std::make_shared<MirrorCommand>();
  CLI::App* command = app.add_subcommand(
      "mirror", "Keep a copy of a map that a server serves, in a store of this machine");
  command->footer(fmt::format(
      "A key, where the server asks for one, stands in the environment: {}.", kKeyVariable));
  command->add_option("URL", asked->url, "Server, such as http://HOST:8080")->required();
  command->add_option("MAP", asked->options.map, "Name of the map, there and here")->required();
  command
      ->add_option("-o,--output", asked->store,
                   "Store that gets it, made if it is missing; `stillmap serve --store` may serve "
                   "it meanwhile")
      ->required()
      ->type_name("FOLDER")
      ->check(command_line::folder_or_new());
  command->add_option("--vehicle", asked->vehicle,
                      "Label of the vehicle, which a roll-out may give another version (default: "
                      "the active version)");
  command
      ->add_option("--rate", asked->megabytes_a_second,
                   "Most megabytes a second, in the mean (default: no limit)")
      ->check(CLI::Range(0.001, 1e6));
  command
      ->add_option("--most", asked->most_megabytes,
                   "Refuse a version of more megabytes (default: no limit)")
      ->check(CLI::Range(0.001, 1e9));
  command
      ->add_option(
          "--around", asked->around,
          "Keep only the regions (640 m) that reach into a circle: x and y in the map frame "
          "and the radius, in metres (default: all)")
      ->expected(3)
      ->type_name("X Y RADIUS");
  command
      ->add_option("--trusted", asked->trusted,
                   "Public keys in PEM: refuse a version that none of them has signed (default: "
                   "take all)")
      ->check(command_line::existing_file());
  command
      ->add_option("--every", asked->every_s,
                   "Look again after so many seconds, until it is stopped (default: once)")
      ->check(CLI::Range(1.0, 86'400.0));
  asked->json.add_to(*command);
  command->callback([asked] { mirror(*asked); });
}

}  // namespace stillmap::cli
