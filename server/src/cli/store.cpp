#include <stillmap/localization/map_index.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_levels.hpp>
#include "blobs/blob_place.hpp"
#include "sealing/seal_keys.hpp"
#include "store/free_bytes.hpp"
#include "store/package_store.hpp"
#include "store/postgres_database.hpp"
#include "store/state_copy.hpp"
#include "store/store_backup.hpp"
#include "store/store_folder.hpp"
#include "store/store_migration.hpp"
#include "store/store_upkeep.hpp"

#include <fmt/chrono.h>
#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <ctime>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <stdexcept>
#include <string>
#include <string_view>
#include <system_error>
#include <thread>
#include <vector>

#include "bodies/maps_json.hpp"
#include "bodies/store_json.hpp"
#include "command_line/progress_bar.hpp"
#include "command_line/result_output.hpp"
#include "command_line/run_program.hpp"
#include "commands.hpp"
#include "config/option_table.hpp"

namespace stillmap::cli {
namespace {

namespace fs = std::filesystem;
using server::PackageStore;

/// Those of all subcommands; each uses some.
struct StoreArguments {
  fs::path store, folder;
  std::string map, version, address;
  std::optional<std::size_t> keep;
  bool activate = false;
  bool reread = false;
  bool dry_run = false;
  /// Of the options that say where packages are, by key.
  std::map<std::string, std::string> place;
  command_line::JsonOutput json;
};

void print(const command_line::JsonOutput& json, const std::string& object,
           const std::string& text) {
  json.write(object);
  if (!json.replaces_text()) fmt::print("{}\n", text);
}

/// `12.3 MB`.
std::string size_text(std::uint64_t bytes) {
  constexpr std::array<const char*, 4> kUnits = {"kB", "MB", "GB", "TB"};
  double size = static_cast<double>(bytes) / 1000.0;
  std::size_t unit = 0;
  for (; size >= 1000.0 && unit + 1 < kUnits.size(); ++unit) size /= 1000.0;
  return fmt::format("{:.1f} {}", size, kUnits.at(unit));
}

std::string line_of(const server::StoredMap& map, const server::StoredVersion& version) {
  const std::string mark = version.name == map.active     ? "active"
                           : version.name == map.previous ? "previous"
                                                          : "";
  return fmt::format("{:<24} {:<24} {:<9} {:>10}  {:%Y-%m-%dT%H:%M:%SZ}  {:.12}\n", map.name,
                     version.name, mark, size_text(version.bytes),
                     fmt::gmtime(static_cast<std::time_t>(version.created_ns / 1'000'000'000)),
                     version.digest);
}

/// All maps, or the one that is named.
void list(const StoreArguments& arguments) {
  require_store(arguments.store);
  const PackageStore store = server::open_store(arguments.store);
  std::vector<server::MapWithVersions> all;
  for (const server::StoredMap& map :
       arguments.map.empty() ? store.state().maps()
                             : std::vector<server::StoredMap>{store.state().map(arguments.map)})
    all.push_back({map, store.state().versions(map.name), store.state().bytes_of_map(map.name)});
  std::string text = fmt::format("{:<24} {:<24} {:<9} {:>10}  {:<20}  {}\n", "map", "version", "",
                                 "size", "added", "digest");
  for (const server::MapWithVersions& each : all) {
    for (const server::StoredVersion& version : each.versions) text += line_of(each.map, version);
    if (each.versions.empty()) text += fmt::format("{:<24} no version\n", each.map.name);
  }
  text += fmt::format("{} on disk, drives included; packages that versions share count once",
                      size_text(arguments.map.empty() ? store.state().bytes() : all.front().bytes));
  print(arguments.json, server::store_list_json(all, store.state().bytes()), text);
}

void verify(const StoreArguments& arguments) {
  require_store(arguments.store);
  const PackageStore store = server::open_store(arguments.store);
  const std::vector<server::StoreProblem> problems = server::verify_store(store);
  std::string text = problems.empty() ? "every package is as it was added" : "";
  for (const server::StoreProblem& problem : problems)
    text += fmt::format("{}{}{}", text.empty() ? "" : "\n",
                        problem.map.empty() ? "" : problem.map + " " + problem.version + ": ",
                        problem.what);
  print(arguments.json, server::problems_json(problems), text);
  if (!problems.empty()) throw command_line::ExitCode{exit_code::kFailed};
}

void gc(const StoreArguments& arguments) {
  require_store(arguments.store);
  PackageStore store = server::open_store(arguments.store);
  std::vector<server::RemovedVersion> removed;
  if (arguments.keep)
    for (const server::StoredMap& map : store.state().maps())
      for (const std::string& version : store.keep_newest(map.name, *arguments.keep))
        removed.push_back({map.name, version});
  const server::ClearedPackages cleared = server::clear_unused(store);
  std::string text;
  for (const server::RemovedVersion& each : removed)
    text += fmt::format("removed version {} of {}\n", each.version, each.map);
  for (const std::string& digest : cleared.packages)
    text += fmt::format("removed package {}, which no version uses\n", digest);
  if (cleared.blobs)
    text += fmt::format("removed {} objects that no package had", *cleared.blobs);
  else
    text += fmt::format("removed {} unused packages and {} leftovers of interrupted writes",
                        cleared.packages.size(), cleared.leftovers);
  print(arguments.json, server::cleared_json(cleared, removed), text);
}

void rotate_seal_key(const StoreArguments& arguments) {
  PackageStore store = server::open_store(arguments.store);
  server::rotate_seal_key(store);
  print(arguments.json, R"({"rotated": true})",
        "sessions are sealed with a new key within seconds; the one before counts for 60 s more");
}

/// Makes index and levels of detail from the map's points, whatever lies there.
/// @throws InputError for a damaged package, whose own then stay.
server::MadeAnew make_anew(const maps::MapPackage& package) {
  if (const auto problems = package.verify(); !problems.empty())
    throw maps::InputError((package.folder() / problems.front()).string(),
                           "bytes that do not match the manifest",
                           "an undamaged package; restore it from a backup, or add it again");
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
  const PackageStore store = server::open_store(arguments.store);
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
  print(arguments.json, server::made_anew_json(all),
        text + fmt::format("{} packages reindexed", all.size()));
  for (const server::MadeAnew& made : all)
    if (!made.is_whole()) throw command_line::ExitCode{exit_code::kFailed};
}

std::string text_of(const server::MigrationPlan& plan, std::uint64_t free_bytes) {
  std::string text;
  for (const server::PackageOfVersions& package : plan.packages)
    text += fmt::format("{:.12} of {}: {}\n", package.digest, package.versions,
                        size_text(package.bytes));
  if (plan.packages.empty()) return "every package is of schema 2";
  return text + fmt::format("{} packages of schema 1; {} must be free ({} bytes), {} are",
                            plan.packages.size(), size_text(plan.room_bytes), plan.room_bytes,
                            size_text(free_bytes));
}

std::string text_of(const server::Migration& migration) {
  std::string text;
  for (const server::MigratedPackage& each : migration.migrated)
    text += fmt::format("{:.12} of {} is {:.12} now: {}, was {}\n", each.former.digest,
                        each.former.versions, each.digest, size_text(each.bytes),
                        size_text(each.former.bytes));
  for (const server::PackageLeft& each : migration.left)
    text += fmt::format("{:.12} of {} stays as it was: {}\n", each.package.digest,
                        each.package.versions, each.why);
  return text + fmt::format("{} packages migrated, {} left", migration.migrated.size(),
                            migration.left.size());
}

void migrate(const StoreArguments& arguments) {
  require_store(arguments.store);
  PackageStore store = server::open_store(arguments.store);
  const server::MigrationPlan plan = server::plan_migration(store);
  if (arguments.dry_run) {
    const std::uint64_t free = server::free_bytes(arguments.store);
    return print(arguments.json, server::migration_plan_json(plan, free), text_of(plan, free));
  }
  command_line::cancel_on_signals();
  command_line::say_when_cancelled(
      {.kept = arguments.store,
       .if_kept = "packages that are migrated stay so; the same command goes on with the rest"});
  server::Migration migration;
  {
    constexpr std::uint64_t kMegabyte = 1'000'000;
    command_line::ProgressBar bar;
    migration = server::migrate_store(
        store, plan,
        [&](std::uint64_t done, std::uint64_t total, const server::PackageOfVersions& package) {
          bar.update("migrate", done / kMegabyte, total / kMegabyte, "MB, " + package.versions);
          return !command_line::cancel_flag();
        });
  }
  print(arguments.json, server::migration_json(migration), text_of(migration));
  if (!migration.left.empty()) throw command_line::ExitCode{exit_code::kFailed};
}

void to_s3(const StoreArguments& arguments) {
  require_store(arguments.store);
  server::ServerOptions options;
  for (const auto& [key, text] : arguments.place) {
    if (text.empty()) continue;
    const server::Option& option = *server::find_option(key);
    const auto value = server::read_value(option, text);
    if (!value || !option.set(options, *value))
      throw std::invalid_argument(option.flag() + ": '" + text + "', expected " +
                                  option.expected());
  }
  std::size_t sent = 0;
  {
    command_line::ProgressBar bar;
    sent = server::move_to_s3(arguments.store, options, [&](std::size_t done, std::size_t total) {
      bar.update("send", done, total, "packages");
    });
  }
  print(arguments.json, server::sent_json(sent),
        fmt::format("{} packages are in {} now, and no longer in the store's folder", sent,
                    options.blobs));
}

void backup(const StoreArguments& arguments) {
  require_store(arguments.store);
  const PackageStore store = server::open_store(arguments.store);
  if (arguments.reread) server::drop_damaged_of_backup(arguments.folder);
  const server::BackedUp done = server::back_up_store(store, arguments.folder);
  print(arguments.json, server::backup_json(done),
        fmt::format("{} packages copied, {} kept from an earlier backup", done.copied, done.kept));
}

void restore(const StoreArguments& arguments) {
  const std::size_t packages = server::restore_store(arguments.folder, arguments.store);
  print(arguments.json, server::restored_json(packages),
        fmt::format("restored {} packages to {}", packages, arguments.store.string()));
}

void attach(const StoreArguments& arguments) {
  PackageStore::make_folder(arguments.store);
  const server::PostgresAddress address(arguments.address);
  PackageStore::attach(arguments.store, address);
  const PackageStore store = server::open_store(arguments.store);
  print(arguments.json, server::attached_json(address.name()),
        fmt::format("{} has its state in {}", arguments.store.string(), address.name()));
}

void copy(const StoreArguments& arguments) {
  require_store(arguments.store);
  const server::PostgresAddress address(arguments.address);
  server::move_state(arguments.store, address);
  print(arguments.json, server::attached_json(address.name()),
        fmt::format("{} has its state in {} now; the one that it had is kept as {}",
                    arguments.store.string(), address.name(), server::kMovedStateName));
}

void add(const StoreArguments& arguments) {
  PackageStore::make_folder(arguments.store);
  PackageStore store = server::open_store(arguments.store);
  const PackageStore::Added added = store.add(arguments.map, arguments.version, arguments.folder);
  if (arguments.activate) store.activate(arguments.map, arguments.version);
  print(arguments.json, server::added_json(arguments.map, added),
        fmt::format("{} {} is {}{}{}", arguments.map, added.version.name, added.version.digest,
                    added.is_new ? "" : ", as before", arguments.activate ? ", active" : ""));
}

void activate(const StoreArguments& arguments) {
  require_store(arguments.store);
  PackageStore store = server::open_store(arguments.store);
  const server::StoredMap map = store.activate(arguments.map, arguments.version);
  print(arguments.json, server::stored_map_json(map),
        fmt::format("{} {} is active, revision {}", map.name, *map.active, map.revision));
}

void rollback(const StoreArguments& arguments) {
  require_store(arguments.store);
  PackageStore store = server::open_store(arguments.store);
  const server::StoredMap map = store.roll_back(arguments.map);
  print(arguments.json, server::stored_map_json(map),
        fmt::format("{} {} is active again, revision {}", map.name, *map.active, map.revision));
}

void remove(const StoreArguments& arguments) {
  require_store(arguments.store);
  PackageStore store = server::open_store(arguments.store);
  const bool gone = store.remove(arguments.map, arguments.version);
  print(arguments.json, server::removed_json({arguments.map, arguments.version}, gone),
        fmt::format("{} {} is removed{}", arguments.map, arguments.version,
                    gone ? ""
                         : "; its package stays while another version uses it, or until "
                           "`stillmap store gc`"));
}

/// A subcommand of `stillmap store` that works on a store.
struct StoreCommand {
  const char* name;
  const char* help;
  void (*run)(const StoreArguments&);
  /// What the store's folder must be.
  CLI::Validator folder = command_line::existing_folder();
};

using Arguments = std::shared_ptr<StoreArguments>;

CLI::App* add_command(CLI::App& group, const Arguments& arguments, const StoreCommand& added) {
  CLI::App* command = group.add_subcommand(added.name, added.help);
  command->add_option("STORE", arguments->store, "Folder of the store")
      ->required()
      ->check(added.folder);
  arguments->json.add_to(*command);
  command->callback([arguments, run = added.run] { run(*arguments); });
  return command;
}

void add_restore(CLI::App& group, const Arguments& arguments) {
  CLI::App* command = group.add_subcommand("restore", "Make a new store from a backup");
  command->add_option("FOLDER", arguments->folder, "Folder of the backup")
      ->required()
      ->check(command_line::existing_folder());
  command->add_option("-o,--output", arguments->store, "Folder of the new store: new or empty")
      ->type_name("FOLDER")
      ->required();
  arguments->json.add_to(*command);
  command->callback([arguments] { restore(*arguments); });
}

void add_to_s3(CLI::App& group, const Arguments& arguments) {
  CLI::App* command = add_command(
      group, arguments,
      {"to-s3",
       "Move all packages from the store's folder to S3; stop the server first. Uploaded drives "
       "stay in the folder",
       to_s3});
  for (const std::string_view key : server::place_keys()) {
    const server::Option& option = *server::find_option(key);
    CLI::Option* const added = command->add_option(
        option.flag(), arguments->place[std::string(key)], std::string(option.text));
    if (key == "blobs" || key == "s3.endpoint") added->required();
  }
}

/// What looks after a store as a whole.
void add_upkeep(CLI::App& group, const Arguments& arguments) {
  add_command(group, arguments,
              {"verify", "Recompute every checksum; exit code 1 when one is wrong", verify});
  add_command(
      group, arguments,
      {"gc", "Remove packages that no version uses, and leftovers of interrupted writes", gc})
      ->add_option(
          "--keep", arguments->keep,
          "Also remove old versions: of each map keep the active one, the previous one and "
          "this many of the newest others");
  add_command(
      group, arguments,
      {"reindex", "Make localization index and levels of detail of all versions again", reindex});
  add_command(
      group, arguments,
      {"migrate",
       "Turn packages of schema 1 into schema 2, which takes half the room; stop the server "
       "first",
       migrate})
      ->add_flag("--dry-run", arguments->dry_run,
                 "Only say what there is to do, and how many bytes must be free");
  CLI::App* saves = add_command(
      group, arguments, {"backup", "Back up the store; a server may run on it meanwhile", backup});
  saves
      ->add_option("-o,--output", arguments->folder,
                   "Folder of the backup: new, or an earlier backup")
      ->type_name("FOLDER")
      ->required();
  saves->add_flag(
      "--reread", arguments->reread,
      "Recompute the checksums of packages from an earlier backup, and copy damaged ones "
      "again");
  add_restore(group, arguments);
  add_to_s3(group, arguments);
  add_command(group, arguments,
              {"rotate-seal-key", "Seal sessions with a new key from now on", rotate_seal_key});
}

/// What concerns a state in PostgreSQL.
void add_state(CLI::App& group, const Arguments& arguments) {
  CLI::App* attaches = add_command(
      group, arguments,
      {"attach", "Make a folder a store whose state is in PostgreSQL, shared with other servers",
       attach, command_line::folder_or_new()});
  CLI::App* copies =
      add_command(group, arguments,
                  {"copy", "Move the state of a store to PostgreSQL; stop its server first", copy});
  attaches->add_option("ADDRESS", arguments->address, "postgres://USER@HOST:PORT/DATABASE")
      ->required();
  copies
      ->add_option("--to", arguments->address,
                   "postgres://USER@HOST:PORT/DATABASE, with nothing in it")
      ->type_name("ADDRESS")
      ->required();
}

/// What changes maps and versions.
void add_changes(CLI::App& group, const Arguments& arguments) {
  CLI::App* adds = add_command(group, arguments,
                               {"add",
                                "Add a map package as a version; makes the store's folder if it is "
                                "missing",
                                add, command_line::folder_or_new()});
  CLI::App* activates = add_command(
      group, arguments, {"activate", "Make a version the active one, which is served", activate});
  CLI::App* rolls_back = add_command(
      group, arguments, {"rollback", "Make the version active that was active before", rollback});
  CLI::App* removes =
      add_command(group, arguments, {"remove", "Remove a version that is not active", remove});
  for (CLI::App* command : {adds, activates, rolls_back, removes})
    command->add_option("MAP", arguments->map, "Name of the map")->required();
  for (CLI::App* command : {adds, activates, removes})
    command->add_option("VERSION", arguments->version, "Name of the version")->required();
  adds->add_option("PACKAGE", arguments->folder, "Folder of the map package")
      ->required()
      ->check(command_line::existing_folder());
  adds->add_flag("--activate", arguments->activate, "Also make it the active version");
}

}  // namespace

void require_store(const fs::path& folder) {
  if (server::PackageStore::is_store(folder)) return;
  throw maps::InputError(
      folder.string(), "no state.db",
      "a store; `stillmap store add`, `stillmap store attach` and `stillmap keys "
      "create` make one");
}

void add_store(CLI::App& app) {
  auto arguments = std::make_shared<StoreArguments>();
  CLI::App* group = app.add_subcommand("store", "Manage the maps and versions of a store");
  group->require_subcommand(1);
  add_command(*group, arguments,
              {"list", "List maps and versions, with the active ones and sizes", list})
      ->add_option("MAP", arguments->map, "Name of a map (default: all)");
  add_changes(*group, arguments);
  add_upkeep(*group, arguments);
  add_state(*group, arguments);
}

}  // namespace stillmap::cli
