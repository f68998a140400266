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

ServedVersion VersionLoader::opened(const std::string& map, const std::string& version,
                                    Fetch fetch) const {
  ServedVersion opened{.map = map, .version = version};
  opened.digest = store_.state().version(map, version).digest;
  opened.copy = store_.copy_of(opened.digest);
  try {
    // What is here stays here while it is opened.
    const auto local = store_.find_local(opened.digest);
    if (!local && fetch == Fetch::kNo)
      opened.state = MapState::kLoading;
    else
      opened.package = store_.open(map, version);
  } catch (const StoreRefusal&) {
    throw;
  } catch (const std::exception& error) {
    spdlog::error("{} cannot be opened: {}", version_text(map, version), error.what());
    opened.state = MapState::kFailed;
    opened.failure = shown(error);
    // What cannot be fetched now may be fetched soon: it is opened again, as if it were another
    // one.
    if (store_.blobs() != nullptr) opened.copy = 0;
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
  } catch (const std::exception& error) {
    version.state = MapState::kFailed;
    version.failure = shown(error);
    spdlog::error("{} cannot be used: {}", version_text(version.map, version.version),
                  error.what());
  }
}

}  // namespace stillmap::server
