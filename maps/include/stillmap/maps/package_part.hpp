#pragma once

#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/region.hpp>

#include <Eigen/Core>

#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <string>

namespace stillmap::maps {

/// A part of a map: a package of some regions of another one, with all of its drives.
struct PackagePart {
  /// Digest of the whole.
  std::string of;
  std::set<RegionId> regions;
  bool operator==(const PackagePart&) const = default;
};

/// What a package is a part of; nothing for one that is no part.
[[nodiscard]] std::optional<PackagePart> part_in(const MapManifest& manifest);

/// Regions of a package that reach into a circle. @param place_map_m  x, y in the map frame.
[[nodiscard]] std::set<RegionId> regions_around(const MapManifest& manifest,
                                                const Eigen::Vector2d& place_map_m,
                                                double radius_m);

/// Files of a part but its packs: those of the drives, and nodes. @param whole  of schema 2.
[[nodiscard]] std::map<std::string, MapManifest::File> files_but_packs(
    const MapManifest& whole, const std::set<RegionId>& regions);

/// Manifest of a part, with the packs that its nodes name.
/// @param folder  has the nodes of `part.regions`, as the whole lists them.
/// @throws InputError for a node that is none, or that names a pack which the whole does not list.
[[nodiscard]] MapManifest manifest_of_part(const MapManifest& whole, const PackagePart& part,
                                           const std::filesystem::path& folder);

}  // namespace stillmap::maps
