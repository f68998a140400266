#include "catalog/map_catalog.hpp"

#include "catalog/rollout_group.hpp"
#include "json/localization_options_json.hpp"

#include "errors/api_error.hpp"
#include "errors/upload_errors.hpp"

#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <stillmap/localization/aligner.hpp>
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

std::string version_text(const std::string& map, const std::string& version) {
  return "version '" + version + "' of map '" + map + "'";
}

ApiError unusable(const ServedVersion& version) {
  return {ErrorCode::kMapUnusable,
          version_text(version.map, version.version) + " cannot be used: " + version.failure};
}

/// 0 also when the version is gone.
std::uint64_t copy_of(const PackageStore& store, const std::string& map,
                      const std::string& version) {
  try {
    return store.copy_of(map, version);
  } catch (const StoreRefusal&) {
    return 0;
  }
}

}  // namespace

MapCatalog::MapCatalog(PackageStore& store, AlignerBuilder builder, Metrics* metrics,
                       std::filesystem::path options_folder)
    : store_(store),
      facts_(store),
      builder_(std::move(builder)),
      options_folder_(std::move(options_folder)),
      metrics_(metrics) {
  follow_store();
  thread_ = std::jthread([this](const std::stop_token& stop) { work(stop); });
}

std::vector<ServedVersion> MapCatalog::active() const {
  const std::scoped_lock lock(mutex_);
  std::vector<ServedVersion> each;
  each.reserve(active_.size());
  for (const auto& [map, active] : active_) each.push_back(slots_.at({map, active.serving}).served);
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
      if (!served.package) throw unusable(served);
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
  ServedVersion served = open(key).served;
  if (!served.package) throw unusable(served);
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
  throw ApiError(ErrorCode::kMapLoading,
                 version_text(served.map, served.version) +
                     " is still being loaded; send the request again after Retry-After")
      .with_header("Retry-After", "1");
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

std::optional<MapSet> MapCatalog::set(std::string_view name) const {
  const std::scoped_lock lock(mutex_);
  const auto found = std::find_if(sets_.begin(), sets_.end(),
                                  [&](const MapSet& each) { return each.name == name; });
  if (found == sets_.end()) return std::nullopt;
  return *found;
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

void MapCatalog::work(const std::stop_token& stop) {
  std::string trouble;
  while (!stop.stop_requested()) {
    std::optional<Key> next;
    {
      std::unique_lock lock(mutex_);
      changed_.wait_for(lock, stop, kStorePeriod,
                        [&] { return store_changed_ || next_to_load().has_value(); });
      store_changed_ = false;
      next = next_to_load();
    }
    if (stop.stop_requested()) return;
    try {
      if (next && load(*next).state == MapState::kReady) serve(*next);
    } catch (const std::exception& error) {
      // A removed version, or a store that cannot be read just now: what is served goes on.
      spdlog::error("{} of the store: {}", version_text(next->first, next->second), error.what());
      note_failure(*next, shown(error));
    }
    try {
      // Also between loads: whoever asks for one version after the other must neither keep them all
      // open nor hide what other processes activate.
      follow_store();
      trouble.clear();
    } catch (const std::exception& error) {
      // Once, not every second.
      if (std::exchange(trouble, error.what()) != error.what())
        spdlog::error("the maps of the store: {}", error.what());
    }
  }
}

/// Serves what the store says is active, as soon as it is loaded.
void MapCatalog::follow_store() {
  const std::scoped_lock what_was_read_holds(follow_mutex_);
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
  follow_rollouts();
  follow_sets();
  notice_replaced();
  notice_trust();
  forget_unused();
}

void MapCatalog::follow(const StoredMap& stored) {
  const std::string& map = stored.name;
  const std::string& version = *stored.active;
  {
    const std::scoped_lock lock(mutex_);
    const auto known = active_.find(map);
    if (known != active_.end()) known->second.stored = stored.revision;
    if (known != active_.end() && known->second.wanted == version) {
      if (known->second.serving == version) known->second.revision = stored.revision;
      return;
    }
  }
  (void)open({map, version});
  const std::scoped_lock lock(mutex_);
  ServedVersion& served = slots_.at({map, version}).served;
  // One that failed before is tried again, since someone wants it again.
  if (served.state != MapState::kReady) served.state = MapState::kLoading;
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
    (void)open(key);
    const std::scoped_lock lock(mutex_);
    const auto slot = slots_.find(key);
    if (slot != slots_.end() && slot->second.served.state != MapState::kReady)
      slot->second.served.state = MapState::kLoading;
  }
  if (!begun.empty()) changed_.notify_all();
}

/// What is open of a package that was damaged is what was damaged: the mended one lies beside it.
void MapCatalog::notice_replaced() {
  std::vector<std::pair<Key, std::uint64_t>> open;
  {
    const std::scoped_lock lock(mutex_);
    for (const auto& [key, slot] : slots_) open.emplace_back(key, slot.served.copy);
  }
  for (const auto& [key, copy] : open) {
    const std::uint64_t now = copy_of(store_, key.first, key.second);
    // Removed: `named` does not ask.
    const bool is_gone = now == 0;
    if (now == copy || (is_gone && !store_.state().is_shared())) continue;
    const std::scoped_lock lock(mutex_);
    const auto slot = slots_.find(key);
    if (slot == slots_.end() || slot->second.served.state == MapState::kLoading) continue;
    if (!is_served(key) && !is_rolled_out(key))
      slots_.erase(slot);
    else if (!is_gone)
      slot->second.replaced = true;
    changed_.notify_all();
  }
}

std::string MapCatalog::distrust_of(std::string_view map, std::string_view version) const {
  try {
    store_.require_signed(map, version);
    return {};
  } catch (const StoreRefusal& refusal) {
    return refusal.reason() == StoreRefusal::Reason::kNotSigned ? refusal.what() : "";
  }
}

/// Keys and signatures may come and go while versions are served.
void MapCatalog::notice_trust() {
  std::vector<Key> open;
  {
    const std::scoped_lock lock(mutex_);
    for (const auto& [key, slot] : slots_) open.push_back(key);
  }
  for (const Key& key : open) {
    const std::string why = distrust_of(key.first, key.second);
    const std::scoped_lock lock(mutex_);
    const auto found = slots_.find(key);
    if (found == slots_.end() || found->second.is_untrusted == !why.empty()) continue;
    Slot& slot = found->second;
    if (slot.served.state == MapState::kLoading) continue;
    slot.is_untrusted = !why.empty();
    if (slot.is_untrusted && slot.served.state == MapState::kReady) {
      spdlog::error("{}", why);
      slot.served.state = MapState::kFailed;
      slot.served.failure = why;
    } else if (!slot.is_untrusted && slot.served.state == MapState::kFailed) {
      slot.served.state = MapState::kLoading;
      changed_.notify_all();
    }
  }
}

/// As clients are told, health without a key too: places of this machine stay in the log.
std::string MapCatalog::shown(const std::exception& error) const {
  return without_places(error.what(), store_);
}

/// @throws StoreRefusal when the store knows no such version.
MapCatalog::Slot MapCatalog::opened(const Key& key) const {
  Slot slot{.served = {.map = key.first, .version = key.second}};
  slot.served.copy = store_.copy_of(key.first, key.second);
  try {
    slot.served.package = store_.open(key.first, key.second);
  } catch (const StoreRefusal&) {
    throw;
  } catch (const std::exception& error) {
    spdlog::error("{} cannot be opened: {}", version_text(key.first, key.second), error.what());
    slot.served.state = MapState::kFailed;
    slot.served.failure = shown(error);
    // What cannot be fetched now may be fetched soon: it is opened again, as if it were another
    // one.
    if (store_.blobs() != nullptr) slot.served.copy = 0;
  }
  return slot;
}

MapCatalog::Slot MapCatalog::open(const Key& key) {
  {
    const std::scoped_lock lock(mutex_);
    const auto found = slots_.find(key);
    if (found != slots_.end()) {
      found->second.last_use = ++uses_;
      return found->second;
    }
  }
  Slot slot = opened(key);
  const std::scoped_lock lock(mutex_);
  slot.last_use = ++uses_;
  return slots_.try_emplace(key, std::move(slot)).first->second;
}

/// Makes a version ready, unless it is. One that failed is tried again: the disk may be well. One
/// whose package was replaced serves as it is when the other cannot be used.
ServedVersion MapCatalog::load(const Key& key) {
  const std::scoped_lock one_at_a_time(load_mutex_);
  const Slot before = open(key);
  Slot slot = before;
  const bool usable = before.served.state == MapState::kReady;
  if (usable && !before.replaced) return before.served;
  if (!before.served.package || before.replaced) slot = opened(key);
  const std::uint64_t tried = slot.served.copy;
  if (slot.served.package) make_ready(slot.served);
  if (metrics_ != nullptr && slot.served.state == MapState::kFailed)
    metrics_->map_load_failed(key.first);
  if (usable && slot.served.state == MapState::kFailed) {
    // The copy that failed is not tried again.
    slot.served = before.served;
    slot.served.copy = tried;
  }
  const std::scoped_lock lock(mutex_);
  slot.last_use = ++uses_;
  return slots_.insert_or_assign(key, std::move(slot)).first->second.served;
}

void MapCatalog::make_ready(ServedVersion& version) const {
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

/// Under the lock. Active versions come before those that someone looks at.
std::optional<MapCatalog::Key> MapCatalog::next_to_load() const {
  std::optional<Key> other;
  for (const auto& [key, slot] : slots_) {
    if (slot.served.state != MapState::kLoading && !slot.replaced) continue;
    if (is_served(key)) return key;
    if (!other) other = key;
  }
  return other;
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
