#pragma once

#include <stillmap/localization/aligner.hpp>
#include <stillmap/maps/map_store.hpp>

#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

namespace stillmap::server {

/// Aligners of one map by method, the default first.
using Aligners = std::vector<std::pair<std::string, std::shared_ptr<const localization::Aligner>>>;
/// Makes a map ready for queries; may take seconds. The package outlives the aligners.
using AlignerBuilder = std::function<Aligners(const maps::MapPackage&)>;

/// Every method of `localization::aligner_names`: the default at once, each other at its first
/// query.
[[nodiscard]] Aligners build_aligners(const maps::MapPackage& map);

enum class MapState { kLoading, kReady, kFailed };

/// One map as requests see it.
struct ServedMap {
  std::string name;
  std::shared_ptr<const maps::MapPackage> package;
  MapState state = MapState::kLoading;
  /// Why the map failed; empty otherwise.
  std::string failure{};
  /// Filled when ready.
  std::shared_ptr<const Aligners> aligners{};

  /// First 12 hex digits of the digest: the map's name for this version in paths.
  [[nodiscard]] std::string version() const { return package->digest().substr(0, 12); }
};

/// The maps of a store and, once its own thread has prepared them, their aligners. Safe from
/// several threads.
class MapCatalog {
 public:
  MapCatalog(const maps::MapStore& store, AlignerBuilder builder);
  MapCatalog(const MapCatalog&) = delete;
  MapCatalog& operator=(const MapCatalog&) = delete;
  /// Waits for the map that is being prepared.
  ~MapCatalog() = default;

  /// All maps as they are now, sorted by name.
  [[nodiscard]] std::vector<ServedMap> maps() const;
  /// @throws ApiError kUnknownMap.
  [[nodiscard]] ServedMap find(std::string_view name) const;
  /// Folders of the store that hold no usable map, and why.
  [[nodiscard]] const std::vector<maps::MapStore::Refusal>& refused() const { return refused_; }

 private:
  void prepare(const std::stop_token& stop);

  AlignerBuilder builder_;
  std::vector<maps::MapStore::Refusal> refused_;
  mutable std::mutex mutex_;
  std::vector<ServedMap> maps_;
  std::jthread thread_;  // last: it uses all of the above
};

}  // namespace stillmap::server
