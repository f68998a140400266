#include "map_catalog.hpp"

#include "api_error.hpp"

#include <spdlog/spdlog.h>

#include <stillmap/localization/map_index.hpp>

#include <algorithm>
#include <exception>

namespace stillmap::server {

Aligners build_aligners(const maps::MapPackage& map) {
  const std::shared_ptr<const localization::MapIndex> index = localization::MapIndex::open(map);
  if (!index->rebuilt_because().empty()) {
    spdlog::info("index of {} was built: {}", map.folder().string(), index->rebuilt_because());
  }
  if (!index->kept_in_memory_because().empty()) {
    spdlog::warn("index of {} is kept in memory and will be built again: {}", map.folder().string(),
                 index->kept_in_memory_because());
  }
  const std::vector<Eigen::Isometry3d> seen_from = localization::seen_from(map);
  Aligners aligners;
  for (const std::string& method : localization::aligner_names()) {
    aligners.emplace_back(method, localization::make_aligner(method, index, seen_from));
  }
  return aligners;
}

MapCatalog::MapCatalog(const maps::MapStore& store, AlignerBuilder builder)
    : builder_(std::move(builder)), refused_(store.refused()) {
  for (const std::string& name : store.names()) {
    maps_.push_back({.name = name, .package = store.find(name)});
  }
  thread_ = std::jthread([this](const std::stop_token& stop) { prepare(stop); });
}

void MapCatalog::prepare(const std::stop_token& stop) {
  for (std::size_t i = 0; i < maps_.size() && !stop.stop_requested(); ++i) {
    // Name and package never change, so they are read without the lock.
    const maps::MapPackage& package = *maps_[i].package;
    std::shared_ptr<const Aligners> aligners;
    std::string failure;
    try {
      aligners = std::make_shared<const Aligners>(builder_(package));
      spdlog::info("map {} version {} is ready", maps_[i].name, maps_[i].version());
    } catch (const std::exception& error) {
      failure = error.what();
      spdlog::error("map {} cannot be used: {}", maps_[i].name, failure);
    }
    const std::scoped_lock lock(mutex_);
    maps_[i].state = aligners ? MapState::kReady : MapState::kFailed;
    maps_[i].aligners = std::move(aligners);
    maps_[i].failure = std::move(failure);
  }
}

std::vector<ServedMap> MapCatalog::maps() const {
  const std::scoped_lock lock(mutex_);
  return maps_;
}

ServedMap MapCatalog::find(std::string_view name) const {
  const std::scoped_lock lock(mutex_);
  const auto found = std::find_if(maps_.begin(), maps_.end(),
                                  [&](const ServedMap& map) { return map.name == name; });
  if (found == maps_.end()) {
    throw ApiError(ErrorCode::kUnknownMap, "there is no map '" + std::string(name) + "'");
  }
  return *found;
}

}  // namespace stillmap::server
