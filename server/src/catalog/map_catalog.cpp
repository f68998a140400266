#include "catalog/map_catalog.hpp"

#include "catalog/rollout_group.hpp"

#include "errors/api_error.hpp"

#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include "store/postgres_database.hpp"

#include <algorithm>
#include <chrono>
#include <exception>
#include <utility>

namespace stillmap::server {
namespace {

/// How often the store is asked what other processes did to it.
constexpr std::chrono::seconds kStorePeriod{1};
/// Versions that are kept open besides the active and the rolled out ones.
constexpr std::size_t kKeptOpen = 4;

constexpr const char* kDamagedAgain =
    "what was fetched to the cache is damaged again: replace the disk of the cache";

ApiError unusable(const ServedVersion& version) {
  return {ErrorCode::kMapUnusable,
          version_text(version.map, version.version) + " cannot be used: " + version.failure};
}

ApiError still_loading(const ServedVersion& version) {
  return ApiError(ErrorCode::kMapLoading,
                  version_text(version.map, version.version) +
                      " is still being loaded; send the request again after Retry-After")
      .with_header("Retry-After", "1");
}

/// Before what could not be fetched is tried again: others get their turn, and the log stays
/// readable.
std::chrono::seconds pause_after(int failed_fetches) {
  constexpr int kMostDoublings = 6;
  return std::chrono::seconds(
      failed_fetches == 0 ? 0 : std::min(60, 1 << std::min(failed_fetches - 1, kMostDoublings)));
}

void require_package(const ServedVersion& version) {
  if (version.package) return;
  throw version.state == MapState::kLoading ? still_loading(version) : unusable(version);
}

}  // namespace

MapCatalog::MapCatalog(PackageStore& store, AlignerBuilder builder, Metrics* metrics,
                       std::filesystem::path options_folder)
    : store_(store),
      facts_(store),
      loader_(store, std::move(builder), metrics, std::move(options_folder)),
      metrics_(metrics) {
  follow_store();
  following_ = std::jthread([this](const std::stop_token& stop) { go_on_following(stop); });
  fetching_ = std::jthread([this](const std::stop_token& stop) {
    go_on(stop, /*with_package=*/false, [this](const Key& key) { (void)fetch(key); });
  });
  loading_ = std::jthread([this](const std::stop_token& stop) {
    go_on(stop, /*with_package=*/true, [this](const Key& key) {
      if (load_once(key).state == MapState::kReady) serve(key);
    });
  });
}

std::vector<ServedVersion> MapCatalog::active() const {
  const std::scoped_lock lock(mutex_);
  std::vector<ServedVersion> each;
  each.reserve(active_.size());
  for (const auto& [map, active] : active_) {
    each.push_back(slots_.at({map, active.serving}).served);
    each.back().revision = active.revision;
  }
  return each;
}

std::vector<ServedVersion> MapCatalog::waiting() const {
  const std::scoped_lock lock(mutex_);
  std::vector<ServedVersion> each;
  for (const auto& [map, active] : active_)
    if (active.wanted != active.serving) each.push_back(slots_.at({map, active.wanted}).served);
  return each;
}

ServedVersion MapCatalog::find(std::string_view map) const {
  {
    const std::scoped_lock lock(mutex_);
    const auto found = active_.find(map);
    if (found != active_.end()) {
      ServedVersion served = slots_.at({found->first, found->second.serving}).served;
      require_package(served);
      served.revision = found->second.revision;
      return served;
    }
  }
  (void)store_.state().map(map);
  throw ApiError(ErrorCode::kNoActiveVersion,
                 "map '" + std::string(map) + "' has no active version");
}

ServedVersion MapCatalog::find(std::string_view map, std::string_view version) {
  const Key key(map, version);
  try {
    // It may be open still and yet be removed.
    (void)store_.state().version(map, version);
  } catch (const StateAway&) {
    // Vehicles that name their version are localized on.
    if (const auto open_already = known(map, version)) return *open_already;
    throw;
  }
  const auto coming = known(map, version);
  if (coming && coming->state == MapState::kLoading) require_package(*coming);
  ServedVersion served = open(key).served;
  require_package(served);
  return served;
}

std::optional<ServedVersion> MapCatalog::known(std::string_view map,
                                               std::string_view version) const {
  const std::scoped_lock lock(mutex_);
  const auto found = slots_.find(Key(map, version));
  if (found == slots_.end()) return std::nullopt;
  return found->second.served;
}

ServedVersion MapCatalog::find_for(std::string_view map, std::string_view vehicle) const {
  {
    const std::scoped_lock lock(mutex_);
    const auto found = rollouts_.find(map);
    if (found != rollouts_.end() && !found->second.halted && is_in_group(found->second, vehicle)) {
      const auto slot = slots_.find({found->first, found->second.version});
      const auto active = active_.find(map);
      if (slot != slots_.end() && slot->second.served.state == MapState::kReady &&
          active != active_.end()) {
        ServedVersion served = slot->second.served;
        served.revision = active->second.revision;
        return served;
      }
    }
  }
  return find(map);
}

ServedVersion MapCatalog::ready(std::string_view map, std::optional<std::string_view> version,
                                std::string_view vehicle, std::int64_t seen_revision) {
  ServedVersion served = version ? named(map, *version) : find_for(map, vehicle);
  if (!version) require_revision(served, seen_revision);
  if (served.state == MapState::kReady) return served;
  if (served.state == MapState::kFailed) throw unusable(served);
  {
    const std::scoped_lock lock(mutex_);
    const auto slot = slots_.find({served.map, served.version});
    if (slot != slots_.end() && slot->second.served.state == MapState::kOpened)
      slot->second.served.state = MapState::kLoading;
  }
  changed_.notify_all();
  throw still_loading(served);
}

/// No vehicle waits for a state that does not answer: where servers share one, a version that is
/// ready is good for poses until this has noticed that it was removed.
ServedVersion MapCatalog::named(std::string_view map, std::string_view version) {
  if (store_.state().is_shared()) {
    const std::scoped_lock lock(mutex_);
    const auto found = slots_.find(Key(map, version));
    if (found != slots_.end() && found->second.served.state == MapState::kReady) {
      found->second.last_use = ++uses_;
      return found->second.served;
    }
  }
  return find(map, version);
}

/// Asks no store: a pose waits for none. @throws ApiError kMapLoading for a map of which the store
/// has a newer revision than this serves, or may have.
void MapCatalog::require_revision(const ServedVersion& served, std::int64_t seen_revision) {
  if (served.revision >= seen_revision) return;
  const std::int64_t stored = [&] {
    const std::scoped_lock lock(mutex_);
    const auto found = active_.find(served.map);
    return found == active_.end() ? 0 : found->second.stored;
  }();
  // A store that was restored has fewer revisions than clients have seen.
  if (stored <= served.revision && claims_.is_refuted(served.map, seen_revision)) return;
  refresh();
  throw ApiError(ErrorCode::kMapLoading,
                 fmt::format("this server still loads revision {} of map '{}': ask another server, "
                             "or this one again after Retry-After",
                             seen_revision, served.map))
      .with_header("Retry-After", "1");
}

StoredMap MapCatalog::activate(std::string_view map, std::string_view version,
                               std::optional<std::int64_t> revision, bool new_frame) {
  const Key key(map, version);
  const StoredMap before = store_.state().map(map);
  store_.require_signed(map, version);
  const ServedVersion next = load(key);
  if (next.state != MapState::kReady) {
    throw ApiError(ErrorCode::kVersionUnusable,
                   version_text(key.first, key.second) + " cannot be loaded: " + next.failure +
                       "; the active version stays. Add a version that loads, or repair this one: "
                       "add the same package again");
  }
  if (before.active && *before.active != key.second && !new_frame) {
    const ServedVersion present = open({key.first, *before.active}).served;
    require_one_frame(present, next);
  } else if (before.active) {
    require_no_set(open({key.first, *before.active}).served, next);
  }
  // What was compared is what must be active still.
  StoredMap after = store_.activate(map, version, revision ? revision : before.revision);
  serve(key);
  // A roll-out of the map has ended.
  refresh();
  return after;
}

StoredMap MapCatalog::roll_back(std::string_view map, std::optional<std::int64_t> revision,
                                bool new_frame) {
  const StoredMap seen = store_.state().map(map);
  if (!seen.previous) return store_.roll_back(map, revision);  // refuses in the store's words
  if (revision.value_or(seen.revision) != seen.revision) return store_.roll_back(map, revision);
  return activate(map, *seen.previous, seen.revision, new_frame);
}

void MapCatalog::require_one_frame(const ServedVersion& present, const ServedVersion& next) const {
  if (!present.package || in_one_frame(present, next)) return;
  throw ApiError(ErrorCode::kOtherFrame,
                 version_text(next.map, next.version) + " is not known to be in the frame of " +
                     version_text(present.map, present.version) +
                     ", so positions may mean other places: build it with --register-to, or "
                     "activate it with new_frame=true");
}

void MapCatalog::require_no_set(const ServedVersion& present, const ServedVersion& next) const {
  if (!present.package || in_one_frame(present, next)) return;
  for (const MapSet& set : store_.state().sets().list())
    for (const MapSet::Member& member : set.maps)
      if (member.map == next.map)
        throw ApiError(ErrorCode::kOtherFrame,
                       version_text(next.map, next.version) + " has another frame, and the set '" +
                           set.name + "' says where the present one lies: take the map out of " +
                           "the set, activate the version, and put the map back with the new place "
                           "of its frame");
}

Rollout MapCatalog::put_rollout(const Rollout& rollout) {
  (void)store_.state().version(rollout.map, rollout.version);
  store_.require_signed(rollout.map, rollout.version);
  const ServedVersion present = find(rollout.map);
  const ServedVersion next = open({rollout.map, rollout.version}).served;
  if (!next.package)
    throw ApiError(ErrorCode::kVersionUnusable, version_text(next.map, next.version) +
                                                    " cannot be opened: " + next.failure +
                                                    "; add the same package again");
  require_one_frame(present, next);
  Rollout kept = store_.rollouts().put(rollout);
  follow_store();
  return kept;
}

void MapCatalog::halt_rollout(const Rollout& rollout, const std::string& reason) {
  const auto halt = [&] {
    const std::scoped_lock lock(mutex_);
    const auto found = rollouts_.find(rollout.map);
    if (found == rollouts_.end() || found->second.begun_ns != rollout.begun_ns) return;
    found->second.halted = true;
    found->second.reason = reason;
  };
  // At once, whatever the disk does.
  halt();
  const std::scoped_lock what_was_read_holds(follow_mutex_);
  const bool is_first = store_.rollouts().halt(rollout, reason);
  halt();
  if (is_first)
    spdlog::error("the roll-out of {} is halted: {}", version_text(rollout.map, rollout.version),
                  reason);
}

void MapCatalog::end_rollout(const std::string& map) {
  store_.rollouts().remove(map);
  follow_store();
}

std::optional<Rollout> MapCatalog::rollout(std::string_view map) const {
  const std::scoped_lock lock(mutex_);
  const auto found = rollouts_.find(map);
  if (found == rollouts_.end()) return std::nullopt;
  return found->second;
}

std::vector<Rollout> MapCatalog::rollouts() const {
  const std::scoped_lock lock(mutex_);
  std::vector<Rollout> each;
  for (const auto& [map, rollout] : rollouts_) each.push_back(rollout);
  return each;
}

std::vector<MapSet> MapCatalog::sets() const {
  const std::scoped_lock lock(mutex_);
  return sets_;
}

bool MapCatalog::put_set(const MapSet& set) {
  const std::scoped_lock what_was_read_holds(follow_mutex_);
  const bool is_new = store_.sets().put(set);
  follow_sets();
  return is_new;
}

bool MapCatalog::remove_set(std::string_view name) {
  const std::scoped_lock what_was_read_holds(follow_mutex_);
  const bool was_there = store_.sets().remove(name);
  follow_sets();
  return was_there;
}

void MapCatalog::follow_sets() {
  std::vector<MapSet> now = store_.state().sets().list();
  const std::scoped_lock lock(mutex_);
  sets_ = std::move(now);
}

bool MapCatalog::in_one_frame(const ServedVersion& a, const ServedVersion& b) const {
  return facts_.frame_of(a.map, a.package->digest()) == facts_.frame_of(b.map, b.package->digest());
}

void MapCatalog::refresh() {
  {
    const std::scoped_lock lock(mutex_);
    store_changed_ = true;
  }
  changed_.notify_all();
}

void MapCatalog::go_on_following(const std::stop_token& stop) {
  std::string trouble;
  while (!stop.stop_requested()) {
    bool is_asked_to = false;
    {
      std::unique_lock lock(mutex_);
      changed_.wait_for(lock, stop, kStorePeriod, [&] { return store_changed_; });
      is_asked_to = std::exchange(store_changed_, false);
    }
    if (stop.stop_requested()) return;
    try {
      follow_store(is_asked_to);
      trouble.clear();
    } catch (const std::exception& error) {
      // Once, not every second.
      if (std::exchange(trouble, error.what()) != error.what())
        spdlog::error("the maps of the store: {}", error.what());
    }
  }
}

/// Prepares one version after the other. @param with_package  those that are here, or those that
/// must be fetched.
void MapCatalog::go_on(const std::stop_token& stop, bool with_package,
                       const std::function<void(const Key&)>& prepare) {
  while (!stop.stop_requested()) {
    std::optional<Key> key;
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, stop, [&] { return next(with_package).has_value(); });
      key = next(with_package);
    }
    if (stop.stop_requested() || !key) return;
    try {
      prepare(*key);
    } catch (const std::exception& error) {
      // A removed version, or a store that cannot be read just now: what is served goes on.
      spdlog::error("{} of the store: {}", version_text(key->first, key->second), error.what());
      note_failure(*key, loader_.shown(error));
    }
    // Whoever asks for one version after the other must not keep them all open.
    forget_unused();
  }
}

/// @param anyway  also when PostgreSQL has told of no change: with many maps and servers, what each
/// reads every second adds up.
void MapCatalog::follow_store(bool anyway) {
  const std::scoped_lock what_was_read_holds(follow_mutex_);
  // Before anything is read: what changes meanwhile is read in the next round.
  const std::optional<std::int64_t> mark = store_.state().told_mark();
  if (anyway || !mark || mark != followed_) {
    followed_.reset();
    follow_maps();
    follow_rollouts();
    follow_sets();
    // Before the digests: what is opened later may be newer than these.
    const std::vector<ServedVersion> versions = known_versions();
    const PackageDigests stored = store_.state().digests();
    const bool knew_all = notice_replaced(versions, &stored);
    if (notice_trust(versions, stored) && knew_all) followed_ = mark;
  } else {
    (void)notice_replaced(known_versions(), nullptr);
  }
  forget_unused();
}

/// Serves what the store says is active, as soon as it is loaded.
void MapCatalog::follow_maps() {
  std::map<std::string, StoredMap, std::less<>> wanted;
  claims_.begin_reading();
  for (StoredMap& map : store_.state().maps())
    if (map.active) wanted.emplace(map.name, std::move(map));
  claims_.end_reading(wanted);
  {
    const std::scoped_lock lock(mutex_);
    std::erase_if(active_, [&](const auto& each) { return !wanted.contains(each.first); });
  }
  for (const auto& [name, map] : wanted) follow(map);
}

void MapCatalog::follow(const StoredMap& stored) {
  const std::string& map = stored.name;
  const std::string& version = *stored.active;
  const Key key(map, version);
  {
    const std::scoped_lock lock(mutex_);
    const auto known = active_.find(map);
    if (known != active_.end()) known->second.stored = stored.revision;
    if (known != active_.end() && known->second.wanted == version) {
      // `serve` has done so, unless the store could not be read then.
      if (slots_.at(key).served.state == MapState::kReady) known->second.serving = version;
      if (known->second.serving == version) known->second.revision = stored.revision;
      return;
    }
  }
  Slot slot = here(key);
  const std::scoped_lock lock(mutex_);
  want(key, std::move(slot));
  const ServedVersion& served = slots_.at(key).served;
  Active& active = active_[map];
  active.wanted = version;
  active.stored = stored.revision;
  // What is being served goes on until the other is ready; without any, this one is loading.
  if (active.serving.empty() || served.state == MapState::kReady) {
    active.serving = version;
    active.revision = stored.revision;
  }
  changed_.notify_all();
}

/// For `want`: open, unless it must be fetched or is known already.
MapCatalog::Slot MapCatalog::here(const Key& key) const {
  if (!known(key.first, key.second)) return opened(key, Fetch::kNo);
  return {.served = {.map = key.first, .version = key.second}};
}

/// Under the lock: loads it soon. One that failed before is tried again, since someone wants it
/// again.
void MapCatalog::want(const Key& key, Slot here) {
  here.last_use = ++uses_;
  ServedVersion& served = slots_.try_emplace(key, std::move(here)).first->second.served;
  if (served.state != MapState::kReady) served.state = MapState::kLoading;
}

/// Loads what is rolled out, once: one that failed is tried again when it is begun again.
void MapCatalog::follow_rollouts() {
  std::map<std::string, Rollout, std::less<>> now;
  for (Rollout& each : store_.state().rollouts().list()) now.emplace(each.map, std::move(each));
  std::vector<Key> begun;
  {
    const std::scoped_lock lock(mutex_);
    for (const auto& [map, rollout] : now) {
      const auto before = rollouts_.find(map);
      const bool is_known = before != rollouts_.end() &&
                            before->second.begun_ns == rollout.begun_ns &&
                            slots_.contains({map, rollout.version});
      if (!rollout.halted && !is_known) begun.emplace_back(map, rollout.version);
    }
    rollouts_ = now;
  }
  for (const Key& key : begun) {
    Slot slot = here(key);
    const std::scoped_lock lock(mutex_);
    want(key, std::move(slot));
  }
  if (!begun.empty()) changed_.notify_all();
}

std::vector<ServedVersion> MapCatalog::known_versions() const {
  const std::scoped_lock lock(mutex_);
  std::vector<ServedVersion> versions;
  versions.reserve(slots_.size());
  for (const auto& [key, slot] : slots_) versions.push_back(slot.served);
  return versions;
}

/// What is open of a package that was damaged is what was damaged: the mended one lies beside it.
/// @param stored  what the store says now; null while it says what it said before.
/// @return false when some must be looked at again, since they are being loaded.
bool MapCatalog::notice_replaced(const std::vector<ServedVersion>& versions,
                                 const PackageDigests* stored) {
  bool knew_all = true;
  for (const ServedVersion& version : versions) {
    const Key key(version.map, version.version);
    std::string digest = version.digest;
    if (stored != nullptr) {
      const auto found = stored->find(key);
      digest = found == stored->end() ? "" : found->second;
    }
    const std::uint64_t now = digest.empty() ? 0 : store_.copy_of(digest);
    // Removed: `named` does not ask.
    const bool is_gone = now == 0;
    if (now == version.copy || (is_gone && !store_.state().is_shared())) continue;
    const std::scoped_lock lock(mutex_);
    const auto slot = slots_.find(key);
    if (slot == slots_.end()) continue;
    // The second: it was opened again since.
    if (slot->second.served.state == MapState::kLoading ||
        slot->second.served.copy != version.copy) {
      knew_all = false;
      continue;
    }
    if (std::chrono::steady_clock::now() < slot->second.fetched_again) {
      knew_all = false;
      continue;
    }
    if (!is_served(key) && !is_rolled_out(key))
      slots_.erase(slot);
    else if (!is_gone)
      slot->second.replaced = true;
    changed_.notify_all();
  }
  return knew_all;
}

std::string MapCatalog::distrust_of(std::string_view map, std::string_view version) const {
  try {
    store_.require_signed(map, version);
    return {};
  } catch (const StoreRefusal& refusal) {
    return refusal.reason() == StoreRefusal::Reason::kNotSigned ? refusal.what() : "";
  }
}

/// Keys and signatures may come and go while versions are served. @return as `notice_replaced`.
bool MapCatalog::notice_trust(const std::vector<ServedVersion>& versions,
                              const PackageDigests& stored) {
  PackageDigests open;
  for (const ServedVersion& version : versions) {
    const auto found = stored.find({version.map, version.version});
    if (found != stored.end()) open.insert(*found);
  }
  const auto refused = store_.not_signed(open);
  bool knew_all = true;
  for (const ServedVersion& version : versions) {
    const Key key(version.map, version.version);
    const auto why = refused.find(key);
    const bool is_untrusted = why != refused.end();
    const std::scoped_lock lock(mutex_);
    const auto found = slots_.find(key);
    if (found == slots_.end()) continue;
    Slot& slot = found->second;
    if (slot.served.state == MapState::kLoading) knew_all = false;
    if (slot.served.state == MapState::kLoading || slot.is_untrusted == is_untrusted) continue;
    slot.is_untrusted = is_untrusted;
    if (is_untrusted && slot.served.state == MapState::kReady) {
      spdlog::error("{}", why->second);
      slot.served.state = MapState::kFailed;
      slot.served.failure = why->second;
    } else if (!is_untrusted && slot.served.state == MapState::kFailed) {
      slot.served.state = MapState::kLoading;
      changed_.notify_all();
    }
  }
  return knew_all;
}

/// @throws StoreRefusal when the store knows no such version.
MapCatalog::Slot MapCatalog::opened(const Key& key, Fetch fetch) const {
  return {.served = loader_.opened(key.first, key.second, fetch)};
}

MapCatalog::Slot MapCatalog::open(const Key& key) {
  {
    const std::scoped_lock lock(mutex_);
    const auto found = slots_.find(key);
    if (found != slots_.end() &&
        (found->second.served.package || found->second.served.state == MapState::kFailed)) {
      found->second.last_use = ++uses_;
      return found->second;
    }
  }
  return fetch(key);
}

/// Opens a version that is not open, wherever its package is. Under no lock: it may take minutes.
MapCatalog::Slot MapCatalog::fetch(const Key& key) {
  Slot slot = opened(key, Fetch::kYes);
  const bool is_here = slot.served.package != nullptr;
  if (!is_here && metrics_ != nullptr) metrics_->map_load_failed(key.first);
  const std::scoped_lock lock(mutex_);
  slot.last_use = ++uses_;
  const auto [found, is_new] = slots_.try_emplace(key, slot);
  Slot& now = found->second;
  // Perhaps another one was faster.
  if (is_new || now.served.package) return now;
  // Someone has asked for more than its package.
  if (is_here) slot.served.state = MapState::kLoading;
  slot.was_damaged = now.was_damaged;
  slot.failed_fetches = is_here ? 0 : now.failed_fetches + 1;
  slot.fetched_again = std::chrono::steady_clock::now() + pause_after(slot.failed_fetches);
  now = std::move(slot);
  changed_.notify_all();
  return now;
}

/// Makes a version ready, unless it is. One that failed is tried again: the disk may be well. One
/// whose package was replaced serves as it is when the other cannot be used.
ServedVersion MapCatalog::load(const Key& key) {
  ServedVersion loaded = load_once(key);
  return loaded.state == MapState::kLoading ? load_once(key) : loaded;
}

/// The same. One that was damaged in the cache is loading afterwards, without a package, once.
ServedVersion MapCatalog::load_once(const Key& key) {
  // What is fetched holds up no other one that is here.
  if (const auto now = known(key.first, key.second); !now || !now->package) (void)fetch(key);
  {
    const std::scoped_lock lock(mutex_);
    const auto now = slots_.find(key);
    if (now != slots_.end() && now->second.served.state == MapState::kReady &&
        !now->second.replaced)
      return now->second.served;
  }
  const std::scoped_lock one_at_a_time(load_mutex_);
  const Slot before = open(key);
  Slot slot = before;
  const bool usable = before.served.state == MapState::kReady;
  if (usable && !before.replaced) return before.served;
  if (before.served.package && before.replaced) slot = opened(key, Fetch::kYes);
  const std::uint64_t tried = slot.served.copy;
  if (slot.served.package) {
    loader_.make_ready(slot.served);
    const bool is_damaged = slot.served.state == MapState::kLoading;
    if (is_damaged && slot.was_damaged) {
      slot.served.state = MapState::kFailed;
      slot.served.failure = kDamagedAgain;
    }
    slot.was_damaged = is_damaged;
    slot.is_untrusted =
        slot.served.state == MapState::kFailed && !distrust_of(key.first, key.second).empty();
    if (metrics_ != nullptr && slot.served.state == MapState::kFailed)
      metrics_->map_load_failed(key.first);
  }
  if (usable && slot.served.state == MapState::kFailed) {
    // The copy that failed is not tried again.
    slot.served = before.served;
    slot.served.copy = tried;
  }
  const std::scoped_lock lock(mutex_);
  slot.replaced = false;
  slot.last_use = ++uses_;
  changed_.notify_all();
  return slots_.insert_or_assign(key, std::move(slot)).first->second.served;
}

/// Under no lock: `key` is loaded, and serves from now on if the store wants it.
void MapCatalog::serve(const Key& key) {
  const std::string& map = key.first;
  const std::scoped_lock what_was_read_holds(follow_mutex_);
  const StoredMap stored = store_.state().map(map);
  const std::scoped_lock lock(mutex_);
  if (!stored.active || *stored.active != key.second || !slots_.contains(key)) return;
  active_.insert_or_assign(map, Active{.serving = key.second,
                                       .wanted = key.second,
                                       .revision = stored.revision,
                                       .stored = stored.revision});
}

void MapCatalog::note_failure(const Key& key, const std::string& why) {
  const std::scoped_lock lock(mutex_);
  const auto slot = slots_.find(key);
  if (slot == slots_.end()) return;
  slot->second.replaced = false;
  if (slot->second.served.state == MapState::kReady) return;
  slot->second.served.state = MapState::kFailed;
  slot->second.served.failure = why;
}

/// Closes the versions that are not served and were not used for longest.
void MapCatalog::forget_unused() {
  const std::scoped_lock lock(mutex_);
  std::vector<std::pair<std::uint64_t, Key>> unused;
  for (const auto& [key, slot] : slots_) {
    if (!is_served(key) && !is_rolled_out(key) && slot.served.state != MapState::kLoading)
      unused.emplace_back(slot.last_use, key);
  }
  std::sort(unused.begin(), unused.end());
  for (std::size_t i = 0; i + kKeptOpen < unused.size(); ++i) slots_.erase(unused[i].second);
}

/// Under the lock. Active versions come before those that someone looks at, and what is new before
/// what is tried again.
std::optional<MapCatalog::Key> MapCatalog::next(bool with_package) const {
  std::optional<Key> best;
  int best_rank = -1;
  for (const auto& [key, slot] : slots_) {
    const bool is_new = slot.served.state == MapState::kLoading;
    if ((!is_new && !slot.replaced) || (slot.served.package != nullptr) != with_package) continue;
    const int rank = (is_served(key) ? 2 : 0) + (is_new ? 1 : 0);
    if (rank <= best_rank) continue;
    best = key;
    best_rank = rank;
  }
  return best;
}

/// Under the lock.
bool MapCatalog::is_served(const Key& key) const {
  const auto found = active_.find(key.first);
  return found != active_.end() &&
         (found->second.serving == key.second || found->second.wanted == key.second);
}

/// Under the lock.
bool MapCatalog::is_rolled_out(const Key& key) const {
  const auto found = rollouts_.find(key.first);
  return found != rollouts_.end() && !found->second.halted && found->second.version == key.second;
}

}  // namespace stillmap::server
