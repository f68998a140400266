#include "signing/ed25519.hpp"

#include <fmt/format.h>
#include <stillmap/maps/map_package.hpp>

#include <memory>
#include <optional>
#include <string>

#include "blobs/blob_place.hpp"
#include "command_line/result_output.hpp"
#include "command_line/run_program.hpp"
#include "command_line/table.hpp"
#include "commands.hpp"
#include "signing/map_signature.hpp"
#include "store/map_name.hpp"
#include "store/package_store.hpp"
#include "store/store_folder.hpp"

namespace stillmap::cli {
namespace {

namespace fs = std::filesystem;

struct SigningArguments {
  fs::path key, package, store, former;
  std::string map, version, digest;
  command_line::JsonOutput json;
};

void require_name(const std::string& map) {
  if (!server::is_valid_map_name(map))
    throw std::invalid_argument("map: '" + map + "', [a-z0-9][a-z0-9._-]{0,62} expected");
}

void print(const SigningArguments& arguments, const server::MapSignature& signature,
           const std::string& what) {
  const std::string text = server::signatures_text({signature});
  arguments.json.write(text.substr(0, text.size() - 1));
  if (!arguments.json.replaces_text()) fmt::print("{}: signed by {}\n", what, signature.key);
}

void make(const SigningArguments& arguments) {
  const server::SigningKey key = server::SigningKey::make();
  const fs::path of_public = arguments.key.string() + ".pub";
  key.write(arguments.key);
  key.write_public(of_public);
  arguments.json.write(fmt::format(R"({{"key": "{}"}})", key.public_key()));
  if (arguments.json.replaces_text()) return;
  command_line::Table table;
  table.add("key", key.public_key());
  table.add("private", arguments.key.string() + ": keep it where you sign, and nowhere else");
  table.add("public", of_public.string() + ": give it to servers (trusted_keys_file) and mirrors");
  table.print();
}

void sign_package(const SigningArguments& arguments) {
  require_name(arguments.map);
  const std::string digest = maps::MapPackage::open(arguments.package)->digest();
  const auto signature = sign_map(server::SigningKey::read(arguments.key), arguments.map, digest);
  server::add_signature_beside(arguments.package, signature);
  print(arguments, signature, arguments.package.string() + " for map " + arguments.map);
}

void sign_digest(const SigningArguments& arguments) {
  require_name(arguments.map);
  const auto signature =
      sign_map(server::SigningKey::read(arguments.key), arguments.map, arguments.digest);
  fmt::print("{}", server::signatures_text({signature}));
}

void sign_version(const SigningArguments& arguments) {
  require_store(arguments.store);
  const auto key = server::SigningKey::read(arguments.key);
  server::PackageStore store = server::open_store(arguments.store);
  const auto version = store.state().version(arguments.map, arguments.version);
  const auto signature = sign_map(key, arguments.map, version.digest);
  store.signatures().add(arguments.map, version.digest, {signature});
  print(arguments, signature, arguments.map + "/" + arguments.version);
}

/// Whatever the former key has signed is signed by the new one too.
void rotate(const SigningArguments& arguments) {
  require_store(arguments.store);
  const auto key = server::SigningKey::read(arguments.key);
  const server::PublicKeys former = server::read_public_keys(arguments.former);
  server::PackageStore store = server::open_store(arguments.store);
  std::size_t versions = 0;
  for (const server::StoredMap& map : store.state().maps()) {
    for (const server::StoredVersion& version : store.state().versions(map.name)) {
      const auto known = store.signatures().of(map.name, version.digest);
      if (!is_signed_by(former, known, map.name, version.digest)) continue;
      store.signatures().add(map.name, version.digest, {sign_map(key, map.name, version.digest)});
      ++versions;
    }
  }
  arguments.json.write(
      fmt::format(R"({{"key": "{}", "versions": {}}})", key.public_key(), versions));
  if (!arguments.json.replaces_text())
    fmt::print("{} versions: signed by {} too\n", versions, key.public_key());
}

}  // namespace

void add_signing(CLI::App& keys) {
  auto arguments = std::make_shared<SigningArguments>();
  CLI::App* group = keys.add_subcommand(
      "sign", "Sign versions of maps (Ed25519), for servers and mirrors that trust a key");
  group->require_subcommand(1);
  const auto add = [&](const char* name, const char* help, void (*run)(const SigningArguments&)) {
    CLI::App* command = group->add_subcommand(name, help);
    command->callback([arguments, run] { run(*arguments); });
    return command;
  };
  const auto add_key = [&](CLI::App* command) {
    command->add_option("--key", arguments->key, "File of the private key")
        ->required()
        ->check(command_line::existing_file());
    return command;
  };
  const auto add_store = [&](CLI::App* command) {
    command->add_option("--store", arguments->store, "Folder of the store")
        ->required()
        ->check(command_line::existing_folder());
  };
  CLI::App* makes = add("make", "Make a key: the files KEY and KEY.pub", make);
  makes->add_option("KEY", arguments->key, "File of the private key; must not exist")->required();
  arguments->json.add_to(*makes);

  CLI::App* package = add_key(
      add("package", "Sign a map package, in a file beside its manifest that goes with uploads",
          sign_package));
  package->add_option("PACKAGE", arguments->package, "Folder of the map package")
      ->required()
      ->check(command_line::existing_folder());
  package->add_option("--map", arguments->map, "Map that it is a version of")->required();
  arguments->json.add_to(*package);

  CLI::App* digest =
      add_key(add("digest", "Sign a version that is elsewhere; print what PUT .../signatures takes",
                  sign_digest));
  digest->add_option("MAP", arguments->map, "Name of the map")->required();
  digest->add_option("DIGEST", arguments->digest, "Digest of the version, 64 digits")
      ->required()
      ->check(CLI::Validator(
          [](std::string& text) {
            return server::is_digest(text) ? std::string() : "not 64 digits of 0-9 and a-f";
          },
          "DIGEST", "digest"));

  CLI::App* version = add_key(add("version", "Sign a version of a store", sign_version));
  version->add_option("MAP", arguments->map, "Name of the map")->required();
  version->add_option("VERSION", arguments->version, "Name of the version")->required();
  add_store(version);
  arguments->json.add_to(*version);

  CLI::App* rotates = add_key(
      add("rotate", "Sign whatever another key has signed in a store, so that it can be taken away",
          rotate));
  rotates->add_option("--former", arguments->former, "File of the other key, public")
      ->required()
      ->check(command_line::existing_file());
  add_store(rotates);
  arguments->json.add_to(*rotates);
}

}  // namespace stillmap::cli
