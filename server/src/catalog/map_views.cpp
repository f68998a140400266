#include "catalog/map_views.hpp"

#include "derived/derived_refusal.hpp"
#include "store/free_bytes.hpp"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/tile_check.hpp>

#include <utility>

namespace stillmap::server {
namespace {

/// Null when it must be made; the reason is logged unless it was never there.
template <typename Open>
auto opened(Open&& open) -> decltype(open()) {
  try {
    return std::forward<Open>(open)();
  } catch (const maps::InputError& error) {
    spdlog::warn("made anew: {}", error.what());
  } catch (const maps::StorageError&) {
    // Not made yet.
  }
  return nullptr;
}

std::shared_ptr<const maps::MapLevels> opened_levels(const maps::MapPackage& package) {
  return opened([&] { return maps::MapLevels::open(package); });
}

std::shared_ptr<const maps::MapDifference> opened_difference(const maps::MapPackage& version,
                                                             const maps::MapPackage& other,
                                                             double tolerance_m) {
  return opened([&] { return maps::MapDifference::open(version, other, tolerance_m); });
}

}  // namespace

std::string ComparedVersions::name() const {
  return fmt::format("{}-{}-{}", version.content(), other.content(),
                     maps::MapDifference::tolerance_mm(tolerance_m));
}

std::vector<maps::MapPoint> MapViews::own_tile(const ServedVersion& version, maps::TileId id) {
  const maps::MapPackage& package = *version.package;
  if (!package.has_tile(id)) return {};
  const std::string content = version.content();
  std::shared_ptr<const WholeTiles> whole = whole_tiles_.find(content);
  if (!whole) whole_tiles_.put(content, whole = std::make_shared<const WholeTiles>());
  const auto is_known = [&] {
    const std::scoped_lock lock(whole->mutex);
    return whole->ids.contains(id);
  };
  if (!is_known()) {
    maps::require_whole_tile(package, id);
    const std::scoped_lock lock(whole->mutex);
    whole->ids.insert(id);
  }
  return package.tile(id).points_from(maps::corner_of(id));
}

DerivedWorker::Answer MapViews::ask_for_levels(const maps::MapPackage& package) {
  // The package may be closed or removed before its turn comes; then this fails.
  const std::filesystem::path& folder = package.folder();
  return worker_.ask("levels of " + package.digest(), [this, folder](const auto& work) {
    const auto map = maps::MapPackage::open(folder);
    if (opened_levels(*map)) return;
    maps::require_whole_tiles(*map, work);
    maps::MapLevels::make(*map, leaving_room(work));
  });
}

/// Fails as soon as it would leave too little.
maps::DerivedWork MapViews::leaving_room(const maps::DerivedWork& work) const {
  return {.threads = work.threads, .go_on = [this, go_on = work.go_on](double share) {
            if (const std::uint64_t room = free_bytes(store_); room < left_free_) {
              throw maps::StorageError(
                  store_.string(),
                  fmt::format("{} bytes of its disk are free, {} are left to other things", room,
                              left_free_));
            }
            return go_on(share);
          }};
}

void MapViews::warm(const maps::MapPackage& package) {
  if (!opened_levels(package)) (void)ask_for_levels(package);
}

std::shared_ptr<const ServedLevels> MapViews::levels(const ServedVersion& version) {
  const std::string content = version.content();
  if (auto found = levels_.find(content)) return found;
  std::shared_ptr<const maps::MapLevels> levels = opened_levels(*version.package);
  if (!levels) refuse_until_made(ask_for_levels(*version.package), "the tileset", store_);
  maps::Tileset tileset(*version.package, *levels);
  auto served =
      std::make_shared<const ServedLevels>(ServedLevels{std::move(levels), std::move(tileset)});
  levels_.put(content, served);
  return served;
}

std::optional<LevelTile> MapViews::level_tile(const ServedVersion& version, maps::TileId id) {
  const std::shared_ptr<const ServedLevels> served = levels(version);
  const maps::TileEntry* entry = served->levels->find(id);
  if (entry == nullptr) return std::nullopt;
  try {
    return LevelTile{*entry, served->levels->points(id)};
  } catch (const maps::InputError& error) {
    spdlog::error("made anew: {}", error.what());
  }
  levels_.forget(version.content());
  maps::MapLevels::remove(*version.package);
  refuse_until_made(ask_for_levels(*version.package), "the tileset", store_);
}

std::shared_ptr<const maps::MapDifference> MapViews::open_difference(const ComparedVersions& pair) {
  return differences_.find(pair.name());
}

DifferenceState MapViews::difference(const ComparedVersions& pair) {
  const std::string name = pair.name();
  if (auto found = differences_.find(name)) return {std::move(found), 1.0};
  if (auto ready =
          opened_difference(*pair.version.package, *pair.other.package, pair.tolerance_m)) {
    differences_.put(name, ready);
    return {std::move(ready), 1.0};
  }
  // Both stay open, so that they stay on the disk.
  const auto work = [this, first = pair.version.package, second = pair.other.package,
                     tolerance_m = pair.tolerance_m](const maps::DerivedWork& how) {
    const auto version = maps::MapPackage::open(first->folder());
    const auto other = maps::MapPackage::open(second->folder());
    if (opened_difference(*version, *other, tolerance_m)) return;
    maps::require_whole_tiles(*version, how);
    maps::require_whole_tiles(*other, how);
    maps::MapDifference::make(*version, *other, tolerance_m, leaving_room(how));
  };
  const DerivedWorker::Answer answer =
      worker_.ask("difference " + name, work, DerivedWorker::Turn::kAfter);
  require_under_way(answer, "the difference", store_);
  return {nullptr, answer.progress};
}

std::vector<maps::MapPoint> MapViews::difference_points(const ComparedVersions& pair,
                                                        const maps::MapDifference& difference,
                                                        const maps::DifferenceTile& tile) {
  try {
    return difference.points(tile);
  } catch (const maps::InputError& error) {
    spdlog::error("made anew: {}", error.what());
  }
  differences_.forget(pair.name());
  maps::MapDifference::remove(*pair.version.package, *pair.other.package, pair.tolerance_m);
  (void)this->difference(pair);
  refuse_until_made({}, "the difference", store_);
}

}  // namespace stillmap::server
