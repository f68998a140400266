#pragma once

#include "catalog/map_catalog.hpp"
#include "derived/derived_worker.hpp"
#include "derived/recently_used.hpp"

#include <stillmap/maps/tile_layer.hpp>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

namespace stillmap::server {

enum class LayerKind : std::uint8_t { kCoverage, kLocalizability };
/// "coverage", "localizability".
[[nodiscard]] std::string_view name_of(LayerKind kind);
/// Nothing for any other name.
[[nodiscard]] std::optional<LayerKind> layer_kind_of(std::string_view name);

/// What is known of the places of a version: kept beside its package (`layers/`), made in the
/// background, one at a time, where it is not there yet. Safe from several threads.
class MapLayers {
 public:
  /// @param store  the store's folder, which messages do not name.
  explicit MapLayers(std::filesystem::path store) : store_(std::move(store)) {}

  /// @throws ApiError kBeingMade with Retry-After, while it is made; kDerivedUnavailable, kBusy.
  [[nodiscard]] std::shared_ptr<const maps::TileLayer> layer(const ServedVersion& version,
                                                             LayerKind kind);

 private:
  static constexpr std::size_t kMostKept = 8;

  void make(const std::string& key, const std::filesystem::path& package, LayerKind kind,
            const maps::DerivedWork& work);

  std::filesystem::path store_;
  RecentlyUsed<maps::TileLayer> kept_{kMostKept};
  DerivedWorker worker_;  // last: it uses all of the above
};

}  // namespace stillmap::server
