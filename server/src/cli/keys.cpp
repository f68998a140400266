#include "blobs/blob_place.hpp"
#include "store/package_store.hpp"

#include <fmt/chrono.h>
#include <fmt/core.h>

#include <ctime>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "bodies/store_json.hpp"
#include "command_line/option_value.hpp"
#include "command_line/result_output.hpp"
#include "command_line/run_program.hpp"
#include "command_line/table.hpp"
#include "commands.hpp"
#include "store/ids_and_times.hpp"

namespace stillmap::cli {
namespace {

struct KeyArguments {
  std::filesystem::path store;
  std::string name, id;
  std::vector<std::string> scopes, maps;
  std::optional<int> expires_days;
  command_line::JsonOutput json;
};

std::string date_of(std::int64_t time_ns) {
  return fmt::format("{:%Y-%m-%dT%H:%M:%SZ}",
                     fmt::gmtime(static_cast<std::time_t>(time_ns / 1'000'000'000)));
}

std::map<std::string, server::KeyScope> scopes_by_name() {
  std::map<std::string, server::KeyScope> scopes;
  for (const server::KeyScope scope : server::all_key_scopes())
    scopes.emplace(name_of(scope), scope);
  return scopes;
}

void create(const KeyArguments& arguments) {
  server::KeyScopes scopes;
  for (const std::string& name : arguments.scopes) scopes.add(scopes_by_name().at(name));
  const std::int64_t now = server::unix_ns();
  std::optional<std::int64_t> expires;
  if (arguments.expires_days)
    expires = now + *arguments.expires_days * std::int64_t{86'400'000'000'000};
  server::PackageStore::make_folder(arguments.store);
  server::PackageStore store = server::open_store(arguments.store);
  const server::KeyTable::Created created =
      store.keys().create(arguments.name, scopes, expires, now, arguments.maps);
  arguments.json.write(server::created_key_json(created));
  if (arguments.json.replaces_text()) return;
  // The key alone stands on stdout, so that a script can take it.
  fmt::print(stderr, "made key {}; copy it now, it is not shown again\n", created.key.id);
  fmt::print("{}\n", created.text);
}

std::string text_of(const server::ApiKey& key) {
  std::string text = key.name + " (";
  for (const server::KeyScope scope : server::all_key_scopes())
    if (key.scopes.has(scope))
      text += (text.back() == '(' ? "" : " ") + std::string(name_of(scope));
  text += ")";
  for (const std::string& map : key.maps)
    text += (&map == &key.maps.front() ? " for maps " : " ") + map;
  text += ", made " + date_of(key.created_ns);
  if (key.revoked_ns) return text + ", revoked " + date_of(*key.revoked_ns);
  if (!key.expires_ns) return text;
  return text + (*key.expires_ns <= server::unix_ns() ? ", expired " : ", until ") +
         date_of(*key.expires_ns);
}

void list(const KeyArguments& arguments) {
  require_store(arguments.store);
  server::PackageStore store = server::open_store(arguments.store);
  const std::vector<server::ApiKey> keys = store.keys().list();
  arguments.json.write(server::keys_json(keys));
  if (arguments.json.replaces_text()) return;
  command_line::Table table;
  for (const server::ApiKey& key : keys) table.add(key.id, text_of(key));
  table.print();
}

void revoke(const KeyArguments& arguments) {
  require_store(arguments.store);
  server::PackageStore store = server::open_store(arguments.store);
  const server::ApiKey key = store.keys().revoke(arguments.id, server::unix_ns());
  arguments.json.write(server::key_json(key));
  if (!arguments.json.replaces_text()) fmt::print("{}  {}\n", key.id, text_of(key));
}

}  // namespace

void add_keys(CLI::App& app) {
  auto arguments = std::make_shared<KeyArguments>();
  CLI::App* group = app.add_subcommand(
      "keys", "Manage the API keys of a store's server, and keys that sign maps");
  group->require_subcommand(1);
  const auto add = [&](const char* name, const char* help, void (*run)(const KeyArguments&),
                       const CLI::Validator& check = command_line::existing_folder()) {
    CLI::App* command = group->add_subcommand(name, help);
    command->add_option("--store", arguments->store, "Folder of the store")
        ->required()
        ->check(check);
    arguments->json.add_to(*command);
    command->callback([arguments, run] { run(*arguments); });
    return command;
  };
  // A century; more is meant to be for ever.
  constexpr int kMostDays = 36'500;
  CLI::App* creates = add("create", "Make a key and print it; it is never shown again", create,
                          command_line::folder_or_new());
  creates->add_option("NAME", arguments->name, "Name of its owner")->required();
  creates
      ->add_option(
          "--scope", arguments->scopes,
          "What the key allows: read, localize, write or admin; may be given several times")
      ->required()
      ->check(command_line::one_of({"read", "localize", "write", "admin"}));
  creates->add_option("--map", arguments->maps,
                      "Map that the key is for, * stands for any text; may be given several times "
                      "(default: all maps)");
  creates
      ->add_option("--expires-days", arguments->expires_days,
                   "Days until the key expires (default: never)")
      ->check(CLI::Range(1, kMostDays));
  add("list", "List the keys", list);
  add("revoke", "Revoke a key; a running server refuses it at once", revoke)
      ->add_option("ID", arguments->id, "The part of the key between its underscores")
      ->required();
  add_signing(*group);
}

}  // namespace stillmap::cli
