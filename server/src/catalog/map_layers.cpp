#include "catalog/map_layers.hpp"

#include "derived/derived_refusal.hpp"

#include <spdlog/spdlog.h>

#include <stillmap/localization/localizability.hpp>
#include <stillmap/localization/map_index.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/layer_file.hpp>
#include <stillmap/maps/tile_check.hpp>

#include <utility>

namespace stillmap::server {
namespace {

std::string key_of(const ServedVersion& version, LayerKind kind) {
  return std::string(name_of(kind)) + " of " + version.content();
}

std::filesystem::path file_of(const maps::MapPackage& package, LayerKind kind) {
  return package.folder() / "layers" / (std::string(name_of(kind)) + ".layer");
}

/// Null when it must be made; the reason is logged unless it was never there.
std::shared_ptr<const maps::TileLayer> read(const maps::MapPackage& package, LayerKind kind) {
  try {
    return std::make_shared<const maps::TileLayer>(
        maps::read_layer(file_of(package, kind), package.digest()));
  } catch (const maps::InputError& error) {
    spdlog::warn("made anew: {}", error.what());
  } catch (const maps::StorageError&) {
    // Not made yet.
  }
  return nullptr;
}

std::optional<maps::TileLayer> made(const maps::MapPackage& package, LayerKind kind,
                                    const maps::GoOn& go_on) {
  if (kind == LayerKind::kCoverage) return maps::coverage_of(package, go_on);
  return localization::localizability_of(package, *localization::MapIndex::open(package), go_on);
}

}  // namespace

std::string_view name_of(LayerKind kind) {
  return kind == LayerKind::kCoverage ? "coverage" : "localizability";
}

std::optional<LayerKind> layer_kind_of(std::string_view name) {
  for (const LayerKind kind : {LayerKind::kCoverage, LayerKind::kLocalizability})
    if (name == name_of(kind)) return kind;
  return std::nullopt;
}

void MapLayers::make(const std::string& key, const std::filesystem::path& package, LayerKind kind,
                     const maps::DerivedWork& work) {
  const auto map = maps::MapPackage::open(package);
  maps::require_whole_tiles(*map, work);
  std::optional<maps::TileLayer> layer =
      made(*map, kind, [&] { return !work.go_on || work.go_on(0.0); });
  if (!layer) throw maps::WorkStopped();
  const auto shared = std::make_shared<const maps::TileLayer>(std::move(*layer));
  try {
    maps::write_layer(file_of(*map, kind), map->digest(), *shared);
  } catch (const maps::StorageError& error) {
    // It is served all the same, and made again when it is forgotten.
    spdlog::warn("a layer is kept in memory alone: {}", error.what());
  }
  kept_.put(key, shared);
}

std::shared_ptr<const maps::TileLayer> MapLayers::layer(const ServedVersion& version,
                                                        LayerKind kind) {
  const maps::MapPackage& package = *version.package;
  const std::string key = key_of(version, kind);
  if (auto found = kept_.find(key)) return found;
  if (auto found = read(package, kind)) {
    kept_.put(key, found);
    return found;
  }
  const DerivedWorker::Answer answer =
      worker_.ask(key, [this, key, folder = package.folder(), kind](const maps::DerivedWork& work) {
        make(key, folder, kind, work);
      });
  refuse_until_made(answer, "the layer", store_);
}

}  // namespace stillmap::server
