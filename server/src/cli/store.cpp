#include <stillmap/localization/map_index.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_levels.hpp>
#include "store/backup_check.hpp"
#include "store/package_store.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "bodies/maps_json.hpp"
#include "bodies/store_json.hpp"
#include "command_line/run_program.hpp"
#include "commands.hpp"

namespace stillmap::cli {
namespace {

namespace fs = std::filesystem;
using server::PackageStore;

/// Those of all subcommands; each uses some.
struct StoreArguments {
  fs::path store, folder;
  std::string map, version;
  std::optional<std::size_t> keep;
  bool activate = false;
  bool reread = false;
  bool json = false;
};

void print(bool json, const std::string& for_programs, const std::string& for_people) {
  fmt::print("{}\n", json ? for_programs : for_people);
}

void verify(const StoreArguments& arguments) {
  require_store(arguments.store);
  const PackageStore store(arguments.store);
  const std::vector<PackageStore::Problem> problems = store.verify();
  std::string text = problems.empty() ? "every package is as it was published" : "";
  for (const PackageStore::Problem& problem : problems)
    text += fmt::format("{}{}{}", text.empty() ? "" : "\n",
                        problem.map.empty() ? "" : problem.map + " " + problem.version + ": ",
                        problem.what);
  print(arguments.json, server::problems_json(problems), text);
  if (!problems.empty()) throw command_line::ExitCode{command_line::kFailed};
}

void gc(const StoreArguments& arguments) {
  require_store(arguments.store);
  PackageStore store(arguments.store);
  std::vector<server::RemovedVersion> removed;
  if (arguments.keep)
    for (const server::StoredMap& map : store.state().maps())
      for (const std::string& version : store.keep_newest(map.name, *arguments.keep))
        removed.push_back({map.name, version});
  const PackageStore::Cleared cleared = store.gc();
  std::string text;
  for (const server::RemovedVersion& each : removed)
    text += fmt::format("removed version {} of {}\n", each.version, each.map);
  for (const std::string& digest : cleared.packages)
    text += fmt::format("removed package {}, which no version names\n", digest);
  text += fmt::format("{} packages without a name and {} leftovers of killed writers removed",
                      cleared.packages.size(), cleared.leftovers);
  print(arguments.json, server::cleared_json(cleared, removed), text);
}

/// Makes index and levels of detail from the map's points, whatever lies there.
/// @throws InputError for a damaged package, whose own then stay.
server::MadeAnew make_anew(const maps::MapPackage& package) {
  if (const auto problems = package.verify(); !problems.empty())
    throw maps::InputError((package.folder() / problems.front()).string(), "other bytes",
                           "those that the manifest states");
  std::error_code error;
  fs::remove_all(package.folder() / "index", error);
  const auto index = localization::MapIndex::open(package);
  server::MadeAnew made{package.digest(), index->kept_in_memory_because(), {}};
  try {
    const std::size_t threads = std::max(1U, std::thread::hardware_concurrency());
    maps::MapLevels::make(package, {.threads = threads, .go_on = {}});
  } catch (const maps::StorageError& failure) {
    made.levels_not_written_because = failure.what();
  }
  return made;
}

std::string text_of(const server::MadeAnew& made) {
  std::string text = made.index_not_written_because.empty()
                         ? "index made"
                         : "not written: " + made.index_not_written_because;
  text += made.levels_not_written_because.empty()
              ? ", levels made"
              : ", levels not written: " + made.levels_not_written_because;
  return text;
}

void reindex(const StoreArguments& arguments) {
  require_store(arguments.store);
  const PackageStore store(arguments.store);
  std::set<std::string> done;
  std::vector<server::MadeAnew> all;
  std::string text;
  for (const server::StoredMap& map : store.state().maps()) {
    for (const server::StoredVersion& version : store.state().versions(map.name)) {
      // Several versions may share one package.
      if (!done.insert(version.digest).second) continue;
      try {
        all.push_back(make_anew(*store.open(map.name, version.name)));
      } catch (const std::runtime_error& error) {
        // A broken package, or one that was removed meanwhile: the others are made all the same.
        all.push_back({version.digest, error.what(), error.what()});
      }
      text += fmt::format("{} {}: {}\n", map.name, version.name, text_of(all.back()));
    }
  }
  print(arguments.json, server::made_anew_json(all), text + fmt::format("{} packages", all.size()));
  for (const server::MadeAnew& made : all)
    if (!made.is_whole()) throw command_line::ExitCode{command_line::kFailed};
}

void backup(const StoreArguments& arguments) {
  require_store(arguments.store);
  const PackageStore store(arguments.store);
  if (arguments.reread) server::drop_damaged_of_backup(arguments.folder);
  const PackageStore::BackedUp done = store.backup(arguments.folder);
  print(arguments.json, server::backup_json(done),
        fmt::format("{} packages copied, {} kept from an earlier backup", done.copied, done.kept));
}

void restore(const StoreArguments& arguments) {
  const std::size_t packages = PackageStore::restore(arguments.folder, arguments.store);
  print(arguments.json, server::restored_json(packages),
        fmt::format("a store of {} packages", packages));
}

void add(const StoreArguments& arguments) {
  PackageStore::make_folder(arguments.store);
  PackageStore store(arguments.store);
  const PackageStore::Added added = store.add(arguments.map, arguments.version, arguments.folder);
  if (arguments.activate) store.activate(arguments.map, arguments.version);
  print(arguments.json, server::added_json(arguments.map, added),
        fmt::format("{} {} is {}{}{}", arguments.map, added.version.name, added.version.digest,
                    added.is_new ? "" : ", as before", arguments.activate ? ", active" : ""));
}

void activate(const StoreArguments& arguments) {
  require_store(arguments.store);
  PackageStore store(arguments.store);
  const server::StoredMap map = store.activate(arguments.map, arguments.version);
  print(arguments.json, server::stored_map_json(map),
        fmt::format("{} {} is active, revision {}", map.name, *map.active, map.revision));
}

void remove(const StoreArguments& arguments) {
  require_store(arguments.store);
  PackageStore store(arguments.store);
  const bool gone = store.remove(arguments.map, arguments.version);
  print(arguments.json, server::removed_json({arguments.map, arguments.version}, gone),
        fmt::format("{} {} is removed{}", arguments.map, arguments.version,
                    gone ? "" : "; its package stays for others, or until `stillmap store gc`"));
}

using Arguments = std::shared_ptr<StoreArguments>;

/// A subcommand of `stillmap store` that works on a store.
CLI::App* add_command(CLI::App& group, const Arguments& arguments, const char* name,
                      const char* help, void (*run)(const StoreArguments&),
                      const CLI::Validator& check = command_line::existing_folder()) {
  CLI::App* command = group.add_subcommand(name, help);
  command->add_option("STORE", arguments->store, "Folder of the store")->required()->check(check);
  command->add_flag("--json", arguments->json, "Print JSON");
  command->callback([arguments, run] { run(*arguments); });
  return command;
}

void add_restore(CLI::App& group, const Arguments& arguments) {
  CLI::App* command = group.add_subcommand("restore", "Make a store of a backup");
  command->add_option("FOLDER", arguments->folder, "A backup")
      ->required()
      ->check(command_line::existing_folder());
  command->add_option("-o,--output", arguments->store, "The store: a new or empty folder")
      ->required();
  command->add_flag("--json", arguments->json, "Print JSON");
  command->callback([arguments] { restore(*arguments); });
}

}  // namespace

void require_store(const fs::path& folder) {
  if (server::PackageStore::is_store(folder)) return;
  throw maps::InputError(folder.string(), "no state.db",
                         "a store, as `stillmap store add` and `stillmap keys create` make one");
}

void add_store(CLI::App& app) {
  auto arguments = std::make_shared<StoreArguments>();
  CLI::App* group = app.add_subcommand("store", "Check, clear, save and fill a store of maps");
  group->require_subcommand(1);
  add_command(*group, arguments, "verify", "Recompute every checksum", verify);
  add_command(*group, arguments, "gc", "Remove what no version names and killed writers left", gc)
      ->add_option(
          "--keep", arguments->keep,
          "Also remove versions of each map: all but the active one, the one before, and so "
          "many of the newest others");
  add_command(*group, arguments, "reindex",
              "Make localization index and levels of detail of every version again", reindex);
  CLI::App* saves =
      add_command(*group, arguments, "backup", "Save the store while it is served", backup);
  saves->add_option("-o,--output", arguments->folder, "A new folder, or an earlier backup")
      ->required();
  saves->add_flag("--reread", arguments->reread,
                  "Recompute the checksums of what an earlier backup brought; what is damaged is "
                  "brought again");
  add_restore(*group, arguments);
  CLI::App* adds =
      add_command(*group, arguments, "add",
                  "Publish a map package as a version; makes the store's folder if it is missing",
                  add, command_line::folder_or_new());
  CLI::App* activates =
      add_command(*group, arguments, "activate", "Make a version the served one", activate);
  CLI::App* removes = add_command(*group, arguments, "remove", "Remove a version", remove);
  for (CLI::App* command : {adds, activates, removes}) {
    command->add_option("MAP", arguments->map, "Name of the map")->required();
    command->add_option("VERSION", arguments->version, "Name of the version")->required();
  }
  adds->add_option("PACKAGE", arguments->folder, "Folder of the package")
      ->required()
      ->check(command_line::existing_folder());
  adds->add_flag("--activate", arguments->activate, "Make it the served one");
}

}  // namespace stillmap::cli
