#pragma once

#include "catalog/map_catalog.hpp"
#include "catalog/tile_list.hpp"
#include "catalog/version_facts.hpp"

#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/package_delta.hpp>
#include <stillmap/maps/trajectory.hpp>

#include <memory>
#include <optional>
#include <string>
#include <vector>

/// Maps and versions as JSON text. `server/reference.md` says what each key means.
namespace stillmap::server {

/// A version of the store, and what is known of it.
struct DescribedVersion {
  StoredVersion stored;
  /// Null when its package cannot be read.
  std::shared_ptr<const VersionFacts> facts{};
  /// `frame_name`; empty without facts.
  std::string frame{};
  /// Digest of the version whose frame it is in, as that one goes now.
  std::optional<std::string> registered_to{};
  /// "stored" when it is not open, else a state of the catalogue.
  std::string state{};
  /// Why it failed; else empty.
  std::string failure{};
};

/// A map of the store with the version that is served of it, if any is.
struct ListedMap {
  StoredMap stored;
  /// The version that is active by `stored`.
  std::optional<ServedVersion> served;
  /// The same, where the store still has it.
  std::optional<DescribedVersion> described;
};

/// What a client calls it.
[[nodiscard]] std::string_view name_of(MapState state);

[[nodiscard]] std::string map_list_json(const std::vector<ListedMap>& maps);
[[nodiscard]] std::string stored_map_json(const StoredMap& map);
[[nodiscard]] std::string map_json(const StoredMap& map, const ServedVersion& version,
                                   const DescribedVersion& described);
[[nodiscard]] std::string tile_list_json(const TilePage& page);
[[nodiscard]] std::string version_json(const StoredVersion& version);
[[nodiscard]] std::string version_list_json(const StoredMap& map,
                                            const std::vector<DescribedVersion>& versions);
/// @param from, to  digests.
[[nodiscard]] std::string delta_json(const std::string& from, const std::string& to,
                                     const maps::PackageDelta& delta);
[[nodiscard]] std::string trajectories_json(const std::vector<maps::Trajectory>& drives);
[[nodiscard]] std::string objects_json(const std::vector<maps::MapObject>& objects);

}  // namespace stillmap::server
