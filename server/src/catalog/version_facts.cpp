#include "catalog/version_facts.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace stillmap::server {
namespace {

/// Facts that are kept; beyond it they are read anew.
constexpr std::size_t kMostKept = 10'000;

std::vector<std::string> drives_of(const maps::MapManifest& manifest) {
  std::vector<std::string> drives;
  const auto add = [&](const std::string& key) {
    const auto found = manifest.sources.find(key);
    if (found != manifest.sources.end()) drives.push_back(found->second);
    return found != manifest.sources.end();
  };
  add("cloud");
  // As the mapper numbers them: drive, drive_2, drive_3.
  if (!add("drive")) return drives;
  for (std::size_t n = 2; add("drive_" + std::to_string(n));) ++n;
  return drives;
}

}  // namespace

VersionFacts facts_of(const maps::MapManifest& manifest) {
  VersionFacts facts{.tiles = manifest.extent.tiles};
  facts.points = manifest.extent.points;
  facts.area_m2 = manifest.extent.area_m2;
  facts.frame_id = manifest.frame_id;
  facts.geodetic_origin = manifest.geodetic_origin;
  if (manifest.registration) facts.registered_to = manifest.registration->previous_digest;
  facts.voxel_size_m = manifest.voxel_size_m;
  facts.software_version = manifest.software_version;
  facts.drives = drives_of(manifest);
  facts.options = manifest.options;
  facts.counts = manifest.counts;
  return facts;
}

std::string frame_name(std::string digest, std::size_t steps, const FactsOf& facts) {
  for (std::size_t step = 0; step <= steps; ++step) {
    const std::shared_ptr<const VersionFacts> known = facts(digest);
    if (!known) return digest;
    if (!known->registered_to) {
      const auto& origin = known->geodetic_origin;
      if (!origin) return digest;
      return fmt::format("{} {} {} {}", known->frame_id, origin->latitude_deg,
                         origin->longitude_deg, origin->altitude_m);
    }
    digest = *known->registered_to;
  }
  return digest;
}

std::shared_ptr<const VersionFacts> VersionFactsTable::of(const std::string& map,
                                                          const StoredVersion& version) const {
  {
    const std::scoped_lock lock(mutex_);
    const auto found = by_digest_.find(version.digest);
    if (found != by_digest_.end()) return found->second;
  }
  const auto facts =
      std::make_shared<const VersionFacts>(facts_of(store_.manifest(map, version.name)));
  const std::scoped_lock lock(mutex_);
  if (by_digest_.size() >= kMostKept) by_digest_.clear();
  return by_digest_.try_emplace(version.digest, facts).first->second;
}

std::string VersionFactsTable::frame_of(const std::string& map, const std::string& digest) const {
  const std::vector<StoredVersion> versions = store_.state().versions(map);
  const FactsOf facts = [&](const std::string& each) -> std::shared_ptr<const VersionFacts> {
    const auto found = std::find_if(versions.begin(), versions.end(),
                                    [digest = store_.state().current_digest(each)](
                                        const auto& version) { return version.digest == digest; });
    return found == versions.end() ? nullptr : of(map, *found);
  };
  return store_.state().first_digest(frame_name(digest, versions.size(), facts));
}

}  // namespace stillmap::server
