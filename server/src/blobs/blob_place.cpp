#include "blobs/blob_place.hpp"

#include <stillmap/maps/error.hpp>

#include <array>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>

#include <stillmap/maps/text.hpp>
#include "blobs/s3_packages.hpp"
#include "config/config_file.hpp"
#include "config/option_table.hpp"
#include "json/json_values.hpp"
#include "store/store_folder.hpp"

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

constexpr const char* kPlaceName = "blobs.json";
constexpr const char* kCacheName = "cache";
constexpr std::string_view kS3Scheme = "s3://";
constexpr std::array<std::string_view, 8> kPlaceKeys = {
    "blobs",     "cache",      "cache_bytes",       "s3.endpoint",
    "s3.region", "s3.ca_file", "s3.virtual_hosted", "s3.credentials_file"};

/// The options that are noted in a store; nothing where there are none.
std::optional<ServerOptions> noted_place(const fs::path& folder) {
  const fs::path file = folder / kPlaceName;
  if (!is_there(file)) return std::nullopt;
  const ConfigText config = parse_config(maps::read_text(file, kMostConfigBytes), file.string());
  if (!config.problems.empty())
    throw maps::InputError(file.string(), config.problems.front().text(),
                           "what `stillmap serve --blobs` has written: put it back");
  ServerOptions options;
  for (const auto& [option, value] : config.values)
    if (!option->set(options, value))
      throw maps::InputError(file.string(), std::string(option->key), option->expected());
  return options;
}

std::string place_text(const ServerOptions& options) {
  Json json;
  for (const std::string_view key : kPlaceKeys) {
    const std::size_t dot = key.find('.');
    Json& group = dot == key.npos ? json : json[std::string(key.substr(0, dot))];
    const std::string name(dot == key.npos ? key : key.substr(dot + 1));
    std::visit([&](const auto& value) { group[name] = value; }, find_option(key)->get(options));
  }
  return to_text(json, 2) + "\n";
}

/// Every command must find the same cache, wherever it is started.
ServerOptions with_whole_paths(ServerOptions options) {
  for (std::string* path : {&options.cache, &options.s3.ca_file, &options.s3.credentials_file})
    if (!path->empty()) *path = fs::absolute(*path).lexically_normal().string();
  return options;
}

void note_place(const fs::path& folder, const ServerOptions& options, DiskCalls& calls) {
  const fs::path file = folder / kPlaceName;
  const std::string text = place_text(options);
  if (is_there(file) && maps::read_text(file, kMostConfigBytes) == text) return;
  const DurableFiles files(calls);
  const fs::path half = file.string() + ".new";
  if (is_there(half)) files.remove_file(half);
  DurableFiles::NewFile out = files.create(half);
  out.append(text);
  out.finish();
  files.rename(half, file);
  files.sync_folder(folder);
}

std::unique_ptr<S3Packages> packages_in_s3(const fs::path& folder, const ServerOptions& options) {
  if (!options.blobs.starts_with(kS3Scheme))
    throw std::invalid_argument("blobs: '" + options.blobs + "', expected s3://BUCKET/PREFIX");
  S3PackagesOptions packages;
  const std::string place = options.blobs.substr(kS3Scheme.size());
  packages.s3.bucket = place.substr(0, place.find('/'));
  if (place.size() > packages.s3.bucket.size())
    packages.s3.prefix = place.substr(packages.s3.bucket.size() + 1);
  packages.s3.endpoint = options.s3.endpoint;
  packages.s3.region = options.s3.region;
  packages.s3.virtual_hosted = options.s3.virtual_hosted;
  packages.s3.credentials_file = options.s3.credentials_file;
  packages.s3.transport.ca_file = options.s3.ca_file;
  packages.cache.folder = options.cache.empty() ? folder / kCacheName : fs::path(options.cache);
  packages.cache.most_bytes = static_cast<std::uint64_t>(options.cache_bytes);
  return std::make_unique<S3Packages>(packages);
}

bool has_packages(const fs::path& folder) {
  if (!is_there(folder / kPackagesName)) return false;
  for (const std::string& name : folders_in(folder / kPackagesName))
    if (is_digest(name)) return true;
  return false;
}

void require_same_place(const fs::path& folder, const ServerOptions& noted,
                        const ServerOptions& options) {
  if (noted.blobs == options.blobs) return;
  throw maps::InputError(folder.string(), "a store with its packages in " + noted.blobs,
                         "one with them in " + options.blobs +
                             ": packages do not move by themselves; leave out --blobs, or restore "
                             "a backup as a new store");
}

}  // namespace

std::span<const std::string_view> place_keys() { return kPlaceKeys; }

PackageStore open_store(const fs::path& folder) {
  const auto noted = noted_place(folder);
  if (!noted) return PackageStore(folder);
  return PackageStore(folder, DiskCalls::real(), packages_in_s3(folder, *noted));
}

PackageStore open_store(const fs::path& folder, const ServerOptions& options) {
  const auto noted = noted_place(folder);
  if (options.blobs.empty() && !noted) return PackageStore(folder);
  if (noted && !options.blobs.empty()) require_same_place(folder, *noted, options);
  if (!noted && has_packages(folder))
    throw maps::InputError(
        folder.string(), "a store with packages in its folder",
        "one without: move them by `stillmap store to-s3`, or leave out --blobs");
  const ServerOptions place = options.blobs.empty() ? *noted : with_whole_paths(options);
  std::unique_ptr<S3Packages> blobs = packages_in_s3(folder, place);
  // Not found when the first map is asked for.
  blobs->require_credentials();
  note_place(folder, place, DiskCalls::real());
  return PackageStore(folder, DiskCalls::real(), std::move(blobs));
}

std::size_t move_to_s3(const fs::path& folder, const ServerOptions& options,
                       const SendProgress& progress) {
  const auto alone = FolderLock::try_folder(folder);
  if (!alone)
    throw maps::InputError(folder.string(), "a store on which a server runs",
                           "one without: stop the server, then move the packages");
  const auto noted = noted_place(folder);
  if (noted) require_same_place(folder, *noted, options);
  const ServerOptions place = with_whole_paths(options);
  const std::unique_ptr<S3Packages> blobs = packages_in_s3(folder, place);
  const DurableFiles files(DiskCalls::real());
  std::size_t done = 0;
  if (!noted) {
    const PackageStore store(folder);
    std::set<std::string> digests;
    for (const StoredMap& map : store.state().maps())
      for (const StoredVersion& version : store.state().versions(map.name))
        digests.insert(version.digest);
    FileBytes sent;
    for (const std::string& digest : digests) {
      const fs::path package = store.packages().path_of(digest);
      if (const std::string damage = store.packages().damage_of(digest); !damage.empty())
        throw maps::InputError(package.string(), damage,
                               "a whole package: add it again, or remove its versions");
      blobs->send(package, sent, /*again=*/false);
      const auto opened = maps::MapPackage::open(package);
      for (const auto& [path, file] : opened->manifest().files)
        sent.emplace(file.sha256, file.bytes);
      ++done;
      if (progress) progress(done, digests.size());
    }
    note_place(folder, place, DiskCalls::real());
  }
  // Nothing reads them any more.
  if (is_there(folder / kPackagesName)) files.remove_tree(folder / kPackagesName);
  return done;
}

}  // namespace stillmap::server
