#pragma once

#include <stillmap/maps/map_package.hpp>
#include "store/package_store.hpp"

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::server {

/// What tells one version of a map from another, out of its manifest.
struct VersionFacts {
  /// Of level 0: coarser levels hold the same points again, thinned.
  std::uint64_t points = 0;
  /// Of all levels.
  std::size_t tiles = 0;
  /// Ground that it covers: of each tile of level 0 the rectangle that its points span [m^2].
  double area_m2 = 0.0;
  std::string frame_id{};
  std::optional<maps::GeodeticOrigin> geodetic_origin{};
  /// Digest of the version whose frame it is in.
  std::optional<std::string> registered_to{};
  double voxel_size_m = 0.0;
  std::string software_version{};
  /// Names of the drives that it was built of, or of the file that it was converted from.
  std::vector<std::string> drives{};
  std::map<std::string, std::string> options{};
  std::map<std::string, std::uint64_t> counts{};
};

[[nodiscard]] VersionFacts facts_of(const maps::MapManifest& manifest);

/// Facts of packages by their digest; nothing for one that is not known here.
using FactsOf = std::function<std::shared_ptr<const VersionFacts>(const std::string& digest)>;

/// Versions with equal names are in one frame for sure. A map's frame is that of the version it was
/// registered to, and so on back; else that of its place on Earth; else its own, since "local" is
/// what every map without either is called.
/// @param steps  most to go back: there are no more than versions.
[[nodiscard]] std::string frame_name(std::string digest, std::size_t steps, const FactsOf& facts);

/// Facts of the store's versions, each read once. Safe from several threads.
class VersionFactsTable {
 public:
  /// @param store  outlives this.
  explicit VersionFactsTable(const PackageStore& store) : store_(store) {}

  /// @throws StoreRefusal kUnknownMap, kUnknownVersion; InputError when its package is broken.
  [[nodiscard]] std::shared_ptr<const VersionFacts> of(const std::string& map,
                                                       const StoredVersion& version) const;
  /// `frame_name` of a version among those of its map. A frame keeps its name when the package that
  /// it is called by is migrated.
  /// @throws InputError when one of the packages that it goes back to is broken.
  [[nodiscard]] std::string frame_of(const std::string& map, const std::string& digest) const;

 private:
  const PackageStore& store_;
  mutable std::mutex mutex_;
  mutable std::map<std::string, std::shared_ptr<const VersionFacts>> by_digest_;
};

}  // namespace stillmap::server
