#include "catalog/version_loader.hpp"

#include "errors/upload_errors.hpp"
#include "json/localization_options_json.hpp"

#include <spdlog/spdlog.h>

#include <chrono>
#include <memory>
#include <utility>

namespace stillmap::server {

std::string version_text(const std::string& map, const std::string& version) {
  return "version '" + version + "' of map '" + map + "'";
}

VersionLoader::VersionLoader(const PackageStore& store, AlignerBuilder builder, Metrics* metrics,
                             std::filesystem::path options_folder)
    : store_(store),
      builder_(std::move(builder)),
      metrics_(metrics),
      options_folder_(std::move(options_folder)) {}

std::string VersionLoader::shown(const std::exception& error) const {
  return without_places(error.what(), store_);
}

bool VersionLoader::drop_damaged(const ServedVersion& version,
                                 const maps::InputError& error) const {
  if (store_.blobs() == nullptr || !store_.blobs()->drop_damaged(version.digest)) return false;
  spdlog::warn("{} was damaged in the cache and is fetched again: {}",
               version_text(version.map, version.version), error.what());
  return true;
}

void VersionLoader::fail(ServedVersion& version, const std::exception& error,
                         const char* what) const {
  version.state = MapState::kFailed;
  version.failure = shown(error);
  // What the cache has is as its checksums say, so only the cache's own trouble is left.
  if (store_.blobs() != nullptr && dynamic_cast<const maps::InputError*>(&error) != nullptr)
    version.failure +=
        "; if other servers can use it, delete the cache of this server and start it again";
  spdlog::error("{} cannot be {}: {}", version_text(version.map, version.version), what,
                error.what());
}

std::shared_ptr<const maps::MapPackage> VersionLoader::fetched(const ServedVersion& version) const {
  try {
    return store_.open(version.map, version.version);
  } catch (const maps::InputError& error) {
    if (!drop_damaged(version, error)) throw;
  }
  return store_.open(version.map, version.version);
}

ServedVersion VersionLoader::opened(const std::string& map, const std::string& version,
                                    Fetch fetch) const {
  ServedVersion opened{.map = map, .version = version};
  opened.digest = store_.state().version(map, version).digest;
  opened.copy = store_.copy_of(opened.digest);
  try {
    if (fetch == Fetch::kYes) {
      opened.package = fetched(opened);
      return opened;
    }
    // What is here stays here while it is opened.
    const auto local = store_.find_local(opened.digest);
    if (local) opened.package = store_.open(map, version);
    if (!local) opened.state = MapState::kLoading;
  } catch (const StoreRefusal&) {
    throw;
  } catch (const std::exception& error) {
    fail(opened, error, "opened");
    // What cannot be fetched now may be fetched soon: it is opened again, as if it were another
    // one.
    const bool is_here = store_.blobs() == nullptr || store_.find_local(opened.digest);
    if (!is_here) opened.copy = 0;
  }
  return opened;
}

void VersionLoader::make_ready(ServedVersion& version) const {
  const auto begin = std::chrono::steady_clock::now();
  version.failure.clear();
  try {
    store_.require_signed(version.map, version.version);
    version.localization = localization_options_of(options_folder_, version.map);
    version.aligners =
        std::make_shared<const Aligners>(builder_(*version.package, version.localization));
    version.seen_from = std::make_shared<SeenFrom>();
    version.state = MapState::kReady;
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
    if (metrics_ != nullptr) metrics_->map_loaded(version.map, took.count());
    spdlog::info("{} is ready", version_text(version.map, version.version));
  } catch (const maps::InputError& error) {
    if (!drop_damaged(version, error)) return fail(version, error, "used");
    version.package.reset();
    version.state = MapState::kLoading;
  } catch (const std::exception& error) {
    fail(version, error, "used");
  }
}

}  // namespace stillmap::server
