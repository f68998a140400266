#pragma once

#include "catalog/revision_claims.hpp"
#include "catalog/served_version.hpp"
#include "catalog/version_facts.hpp"
#include "catalog/version_loader.hpp"
#include "metrics/metrics.hpp"

#include "store/package_store.hpp"

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
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

/// Versions of the store's maps, open and, once they have been prepared, with their aligners: the
/// active ones and those that are rolled out always, others when they are asked for. Queries keep
/// the version they began with.
///
/// One thread follows the store: it notices within a second or two what other processes activate
/// and halt, and when a damaged package is replaced. Another one fetches packages that lie
/// elsewhere, and a third makes aligners. So neither a slow S3 nor a large map keeps this from
/// following, nor a slow S3 from loading what is here. Safe from several threads.
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
  /// @throws ApiError kNoActiveVersion, kMapUnusable, kMapLoading while it is being fetched;
  /// StoreRefusal kUnknownMap.
  [[nodiscard]] ServedVersion find(std::string_view map) const;
  /// Any version that the store has now, fetched and opened when it is not yet.
  /// @throws ApiError kMapUnusable, kMapLoading while another one fetches it; StoreRefusal
  /// kUnknownMap, kUnknownVersion.
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
  /// @param new_frame  whether its map frame may differ from that of the active version, of a map
  /// that is in no set.
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
  using Fetch = VersionLoader::Fetch;
  struct Slot {
    ServedVersion served;
    std::uint64_t last_use = 0;
    /// The store has another copy now, which must be loaded.
    bool replaced = false;
    /// It was removed from the cache, because it was damaged there, and fetched again.
    bool was_damaged = false;
    /// No trusted key has signed it.
    bool is_untrusted = false;
    /// Fetches that failed in a row, and when the next one is due.
    int failed_fetches = 0;
    std::chrono::steady_clock::time_point fetched_again{};
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

  void go_on_following(const std::stop_token& stop);
  void follow_store(bool anyway = true);
  void follow_maps();
  void follow(const StoredMap& stored);
  void require_revision(const ServedVersion& served, std::int64_t seen_revision);
  void follow_rollouts();
  void follow_sets();
  void require_one_frame(const ServedVersion& present, const ServedVersion& next) const;
  void require_no_set(const ServedVersion& present, const ServedVersion& next) const;
  [[nodiscard]] std::vector<ServedVersion> known_versions() const;
  bool notice_replaced(const std::vector<ServedVersion>& versions, const PackageDigests* stored);
  [[nodiscard]] ServedVersion named(std::string_view map, std::string_view version);
  bool notice_trust(const std::vector<ServedVersion>& versions, const PackageDigests& stored);
  [[nodiscard]] Slot here(const Key& key) const;
  void want(const Key& key, Slot here);
  [[nodiscard]] Slot opened(const Key& key, Fetch fetch) const;
  Slot open(const Key& key);
  Slot fetch(const Key& key);
  ServedVersion load(const Key& key);
  ServedVersion load_once(const Key& key);
  void go_on(const std::stop_token& stop, bool with_package,
             const std::function<void(const Key&)>& prepare);
  void serve(const Key& key);
  void note_failure(const Key& key, const std::string& why);
  void forget_unused();
  [[nodiscard]] std::optional<Key> next(bool with_package) const;
  [[nodiscard]] bool is_served(const Key& key) const;
  [[nodiscard]] bool is_rolled_out(const Key& key) const;

  PackageStore& store_;
  VersionFactsTable facts_;
  VersionLoader loader_;
  Metrics* metrics_;
  /// One version is made ready at a time.
  std::mutex load_mutex_;
  /// Held from reading what the store says is active until that is served. Before `mutex_`.
  std::mutex follow_mutex_;
  /// `StoreState::told_mark` before all of the store was read last. Under `follow_mutex_`.
  std::optional<std::int64_t> followed_;
  mutable std::mutex mutex_;
  std::condition_variable_any changed_;
  bool store_changed_ = false;
  std::uint64_t uses_ = 0;
  std::map<Key, Slot> slots_;
  std::map<std::string, Active, std::less<>> active_;
  RevisionClaims claims_;
  std::map<std::string, Rollout, std::less<>> rollouts_;
  std::vector<MapSet> sets_;
  std::jthread following_, fetching_, loading_;  // last: they use all of the above
};

}  // namespace stillmap::server
