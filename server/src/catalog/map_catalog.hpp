#pragma once

#include "catalog/aligners.hpp"
#include "catalog/revision_claims.hpp"
#include "catalog/version_facts.hpp"
#include "metrics/metrics.hpp"

#include "store/package_store.hpp"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <condition_variable>
#include <cstdint>
#include <exception>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

namespace stillmap::server {

enum class MapState : std::uint8_t {
  kOpened,   ///< its points can be read; nobody has asked for poses
  kLoading,  ///< its aligners are being made
  kReady,
  kFailed,
};

/// `localization::seen_from`, read when somebody asks first: loading a map does not wait for its
/// trajectories. Safe from several threads.
class SeenFrom {
 public:
  /// @throws maps::InputError, maps::StorageError: the package may have been removed meanwhile.
  [[nodiscard]] const std::vector<Eigen::Isometry3d>& poses(const maps::MapPackage& map) {
    read(map);
    return T_map_lidar_;
  }
  /// Distance from a place to the nearest of them [m], to half a metre; infinite without any.
  /// @throws as `poses`.
  [[nodiscard]] double distance_m(const maps::MapPackage& map, const Eigen::Vector3d& p_map) {
    read(map);
    double nearest_m2 = std::numeric_limits<double>::infinity();
    for (const Eigen::Vector3d& place : p_map_places_)
      nearest_m2 = std::min(nearest_m2, (place - p_map).squaredNorm());
    return std::sqrt(nearest_m2);
  }

 private:
  void read(const maps::MapPackage& map) {
    constexpr double kApartM = 0.5;
    std::call_once(once_, [&] {
      T_map_lidar_ = localization::seen_from(map);
      for (const Eigen::Isometry3d& T : T_map_lidar_)
        if (p_map_places_.empty() || (T.translation() - p_map_places_.back()).norm() > kApartM)
          p_map_places_.push_back(T.translation());
    });
  }

  std::once_flag once_;
  std::vector<Eigen::Isometry3d> T_map_lidar_;
  /// Without those where the vehicle stood.
  std::vector<Eigen::Vector3d> p_map_places_;
};

/// One version of a map as requests see it. Its tiles stay usable while it is held, whatever
/// becomes of the version meanwhile.
struct ServedVersion {
  std::string map;
  std::string version;
  /// Null only when it failed to open.
  std::shared_ptr<const maps::MapPackage> package{};
  /// As of `PackageStore::copy_of`, before it was opened: what was made of a damaged copy is not
  /// what a mended one makes.
  std::uint64_t copy = 0;
  /// The map's, when this was found to be what it serves; 0 for a version that was asked for by
  /// its name.
  std::int64_t revision = 0;
  MapState state = MapState::kOpened;
  /// Why it failed; empty otherwise.
  std::string failure{};
  /// How scans are localized in it, filled when ready.
  localization::LocalizationOptions localization{};
  /// Filled when ready. Last: they use the package.
  std::shared_ptr<const Aligners> aligners{};
  /// When ready.
  std::shared_ptr<SeenFrom> seen_from{};

  /// Names what it holds, as no other content and no other copy of it does.
  [[nodiscard]] std::string content() const {
    return package->digest() + "@" + std::to_string(copy);
  }
};

/// Versions of the store's maps, open and, once a thread of its own has prepared them, with their
/// aligners: the active ones and those that are rolled out always, others when they are asked for.
/// Queries keep the version they began with. Notices within a second or two what other processes
/// activate, and when a damaged package is replaced. Safe from several threads.
class MapCatalog {
 public:
  /// @param store  outlives this. @param metrics  counts loads when there; outlives this.
  /// @param options_folder  of `localization_options_of`; empty where all maps have the defaults.
  MapCatalog(PackageStore& store, AlignerBuilder builder, Metrics* metrics = nullptr,
             std::filesystem::path options_folder = {});
  MapCatalog(const MapCatalog&) = delete;
  MapCatalog& operator=(const MapCatalog&) = delete;
  /// Waits for the version that is being prepared.
  ~MapCatalog() = default;

  /// The version that is served of each map which has an active one, sorted by map.
  [[nodiscard]] std::vector<ServedVersion> active() const;
  /// Versions that the store calls active and that are not served yet, or cannot be, while
  /// another is.
  [[nodiscard]] std::vector<ServedVersion> waiting() const;
  /// The version that is served of a map.
  /// @throws ApiError kNoActiveVersion, kMapUnusable; StoreRefusal kUnknownMap.
  [[nodiscard]] ServedVersion find(std::string_view map) const;
  /// Any version that the store has now, opened when it is not yet.
  /// @throws ApiError kMapUnusable; StoreRefusal kUnknownMap, kUnknownVersion.
  [[nodiscard]] ServedVersion find(std::string_view map, std::string_view version);

  /// As it is now, without opening it; nothing when it is not open.
  [[nodiscard]] std::optional<ServedVersion> known(std::string_view map,
                                                   std::string_view version) const;
  /// The version that a vehicle gets which names none: that of a running roll-out, once it is
  /// ready, for those in its group, else the one that is served. @param vehicle  label; empty: in
  /// no group.
  /// @throws as `find(map)`.
  [[nodiscard]] ServedVersion find_for(std::string_view map, std::string_view vehicle) const;
  /// What the versions of the store were made of, open or not.
  [[nodiscard]] const VersionFactsTable& facts() const { return facts_; }

  /// The same, for poses. @param vehicle  as of `find_for`, without a version.
  /// @param seen_revision  of the map, as another server may have served it: what is older is not
  /// given out unless the store, read after that was said first, had nothing so new.
  /// @throws also ApiError kMapLoading, with Retry-After; StateAway for a version that is not
  /// ready.
  [[nodiscard]] ServedVersion ready(std::string_view map, std::optional<std::string_view> version,
                                    std::string_view vehicle = {}, std::int64_t seen_revision = 0);

  /// Loads the version, makes it the active one, and serves it from then on. When it cannot be
  /// loaded nothing changes.
  /// @param revision   as in `StoreState::activate`.
  /// @param new_frame  whether its map frame may differ from that of the active version.
  /// @throws ApiError kVersionUnusable, kOtherFrame; StoreRefusal as `PackageStore::activate`.
  StoredMap activate(std::string_view map, std::string_view version,
                     std::optional<std::int64_t> revision = {}, bool new_frame = false);
  /// The same with the version that was active before. @throws also StoreRefusal kNoPrevious.
  StoredMap roll_back(std::string_view map, std::optional<std::int64_t> revision = {},
                      bool new_frame = false);
  /// Begins a roll-out or changes it, as `RolloutTable::put`; its version is loaded in the
  /// background and stays loaded.
  /// @throws ApiError kVersionUnusable for one that cannot be opened, kOtherFrame,
  /// kNoActiveVersion; StoreRefusal as `RolloutTable::put`.
  Rollout put_rollout(const Rollout& rollout);
  /// All vehicles get the active version from now on.
  void halt_rollout(const Rollout& rollout, const std::string& reason);
  /// The same, and nothing is kept of it. @throws StoreRefusal kUnknownMap.
  void end_rollout(const std::string& map);
  /// Of a map, running or halted.
  [[nodiscard]] std::optional<Rollout> rollout(std::string_view map) const;
  /// Sorted by map.
  [[nodiscard]] std::vector<Rollout> rollouts() const;
  /// Sorted by name, as the store had them a second ago, or when it was reached last.
  [[nodiscard]] std::vector<MapSet> sets() const;
  [[nodiscard]] std::optional<MapSet> set(std::string_view name) const;
  /// As `SetTable::put` and `remove`; what the catalogue knows follows at once.
  bool put_set(const MapSet& set);
  bool remove_set(std::string_view name);
  /// Why no trusted key has signed a version; empty when one has, when none needs to, and for a
  /// version that is gone.
  [[nodiscard]] std::string distrust_of(std::string_view map, std::string_view version) const;
  /// Whether two versions are known to be in one map frame: the same, registered to one another
  /// (over others), or at one place on Earth. @param a, b  of one map, both open.
  [[nodiscard]] bool in_one_frame(const ServedVersion& a, const ServedVersion& b) const;
  /// Serves what the store says now, soon: for changes that did not pass this class.
  void refresh();

 private:
  using Key = std::pair<std::string, std::string>;  // map, version
  struct Slot {
    ServedVersion served;
    std::uint64_t last_use = 0;
    /// The store has another copy now, which must be loaded.
    bool replaced = false;
    /// No trusted key has signed it.
    bool is_untrusted = false;
  };
  struct Active {
    std::string serving;
    /// What the store says; becomes `serving` once it is loaded.
    std::string wanted;
    /// The newest revision of the map that is known to have `serving` as its active version.
    std::int64_t revision = 0;
    /// Of the map, as the store had it last.
    std::int64_t stored = 0;
  };

  void work(const std::stop_token& stop);
  void follow_store();
  void follow(const StoredMap& stored);
  void require_revision(const ServedVersion& served, std::int64_t seen_revision);
  void follow_rollouts();
  void follow_sets();
  void require_one_frame(const ServedVersion& present, const ServedVersion& next) const;
  void notice_replaced();
  [[nodiscard]] ServedVersion named(std::string_view map, std::string_view version);
  void notice_trust();
  [[nodiscard]] std::string shown(const std::exception& error) const;
  [[nodiscard]] Slot opened(const Key& key) const;
  Slot open(const Key& key);
  ServedVersion load(const Key& key);
  void make_ready(ServedVersion& version) const;
  void serve(const Key& key);
  void note_failure(const Key& key, const std::string& why);
  void forget_unused();
  [[nodiscard]] std::optional<Key> next_to_load() const;
  [[nodiscard]] bool is_served(const Key& key) const;
  [[nodiscard]] bool is_rolled_out(const Key& key) const;

  PackageStore& store_;
  VersionFactsTable facts_;
  AlignerBuilder builder_;
  std::filesystem::path options_folder_;
  Metrics* metrics_;
  /// One version is made ready at a time.
  std::mutex load_mutex_;
  /// Held from reading what the store says is active until that is served. Before `mutex_`.
  std::mutex follow_mutex_;
  mutable std::mutex mutex_;
  std::condition_variable_any changed_;
  bool store_changed_ = false;
  std::uint64_t uses_ = 0;
  std::map<Key, Slot> slots_;
  std::map<std::string, Active, std::less<>> active_;
  RevisionClaims claims_;
  std::map<std::string, Rollout, std::less<>> rollouts_;
  std::vector<MapSet> sets_;
  std::jthread thread_;  // last: it uses all of the above
};

}  // namespace stillmap::server
